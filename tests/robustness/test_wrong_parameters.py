"""Every check that needs no mesh: what is refused, with its key and all at once."""

from __future__ import annotations

import re
from typing import Any

import pytest
from wrong_values import SECTIONS_WRONG, STUDIES_WRONG, WRONG, nested

from contact_locking.errors import InputError
from contact_locking.study_file import from_mapping

pytestmark = pytest.mark.serial


@pytest.mark.parametrize(("key", "value"), WRONG)
def test_a_wrong_value_is_refused_with_its_key(key: str, value: Any) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping(nested(key, value))
    text = str(caught.value)
    assert text.startswith(key) or re.match(key.rpartition(".")[0] or key, text)
    assert "\n" not in text
    assert "pydantic" not in text
    assert "Input should" not in text


def test_dimension_of_a_file_is_checked_when_it_is_known() -> None:
    loads = {"tractions": [{"on": "anything", "value": [0, 0, "z"]}]}
    parameters = from_mapping({"mesh": {"file": __file__}, "loads": loads})
    assert parameters.mesh.dim is None
    parameters.check_dimension(3)
    with pytest.raises(InputError, match="2 components in 2D") as caught:
        parameters.check_dimension(2)
    assert caught.value.key == "loads.tractions.0.value"


def test_ellipticity_depends_on_the_dimension() -> None:
    # 2 lambda + 2 mu = 0.2 > 0 but 3 lambda + 2 mu = -0.7 < 0
    elasticity = {"lambda": -0.9, "mu": 1}
    mesh = {"file": __file__}
    parameters = from_mapping({"mesh": mesh, "material": {"elasticity": elasticity}})
    parameters.check_dimension(2)
    with pytest.raises(InputError, match="not elliptic") as caught:
        parameters.check_dimension(3)
    assert caught.value.key == "material.elasticity.lambda"


def test_all_that_is_wrong_is_reported_at_once() -> None:
    with pytest.raises(InputError) as caught:
        from_mapping({"penalty": {"n": 0, "epsilon": -1}, "title": 1, "nonsense": 1})
    assert len(str(caught.value).splitlines()) == 4


@pytest.mark.parametrize("study", STUDIES_WRONG)
def test_a_study_that_cannot_run_is_refused(study: Any) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping({"study": study})
    assert str(caught.value).startswith("study")


@pytest.mark.parametrize(("key", "data"), SECTIONS_WRONG)
def test_a_wrong_section_is_refused_with_its_key_alone(key: str, data: Any) -> None:
    with pytest.raises(InputError) as caught:
        from_mapping(data)
    assert str(caught.value).startswith(f"{key}: ")
    assert "\n" not in str(caught.value)
