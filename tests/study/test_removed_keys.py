"""Keys that earlier versions had are refused with what to do instead."""

from __future__ import annotations

from typing import Any

import pytest

from contact_locking.errors import InputError
from contact_locking.study_file import from_mapping
from contact_locking.study_file.parameters import removed


@pytest.mark.parametrize(("given", "key"), [({"output": {"animation": True}}, "output.animation")])
def test_a_removed_key_is_refused_with_what_to_do_instead(given: dict[str, Any], key: str) -> None:
    with pytest.raises(InputError, match=key) as caught:
        from_mapping(given)
    assert removed.KEYS[key.rpartition(".")[2]] in str(caught.value)
