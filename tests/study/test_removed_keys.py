"""Keys and values that earlier versions had are refused with what to do instead."""

from __future__ import annotations

from typing import Any

import pytest

from contact_locking.errors import InputError
from contact_locking.study_file import from_mapping
from contact_locking.study_file.parameters.wording import REMOVED_KEYS, REMOVED_VALUES

pytestmark = pytest.mark.serial


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("adapt.by", "bound"),
        ("certificate.bound_meshes", 4),
        ("friction.coefficient", float("inf")),
        ("friction.smoothing.at_supports", "vanish"),
        ("contact.foundation.tilt", {"about": [0.0, 0.0]}),
        ("material.limits_of", "elastic"),
        ("mesh.curved", True),
        ("output.animation", True),
        ("solver.friction", "nested"),
        ("discretisation.limit_at", "gauss"),
        ("mesh.facets", "facets.xdmf"),
    ],
)
def test_what_has_gone_is_refused_by_its_key_with_what_to_do_instead(key: str, value: Any) -> None:
    *path, last = key.split(".")
    data: dict[str, Any] = {"contact": {"on": "bottom"}}
    section = data
    for name in path:
        section = section.setdefault(name, {})
    section[last] = value
    with pytest.raises(InputError) as caught:
        from_mapping(data)
    message = str(caught.value)
    advice = REMOVED_KEYS.get(key) or REMOVED_KEYS.get(last) or REMOVED_VALUES[last, str(value)]
    assert key in message and advice in message


def test_a_norm_that_has_gone_is_refused_by_its_key() -> None:
    limit = {"norm": "largest_principal", "at_most": 0.01}
    with pytest.raises(InputError, match=r"material\.locking\.0\.norm") as caught:
        from_mapping({"material": {"locking": [limit]}})
    assert REMOVED_VALUES["norm", "largest_principal"] in str(caught.value)
