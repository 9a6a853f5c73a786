"""Study files with anything in them are accepted, or refused with an error of ours."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest
from block_study import BLOCK
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_locking.errors import InputError
from contact_locking.study_file import from_mapping, load
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.source import read

pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For property tests, whose examples share it."""
    return tmp_path_factory.mktemp("studies")


KEYS = (
    "title mesh builder dim size h material elasticity young stiffness locking_limit regions loads",
    "tractions displacements on value contact gap foundation sphere centre radius friction zip",
    "coefficient smoothing kernel penalty n epsilon solver petsc study vary output directory",
    "block geometric linear left top bottom body x*y s z penalty.n .inf 1e4 nan",
)
WORDS = st.sampled_from(" ".join(KEYS).split())
SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), WORDS, st.text(max_size=5)
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(WORDS, inner, max_size=4),
    max_leaves=6,
)


def _containers(data: Any) -> list[Any]:
    if not isinstance(data, dict | list):
        return []
    below = data.values() if isinstance(data, dict) else data
    return [data, *(inner for item in below for inner in _containers(item))]


def _accepted_or_refused(data: Any) -> None:
    try:
        assert isinstance(from_mapping(data), Parameters)
    except InputError as error:
        assert str(error)


@pytest.fixture(scope="module")
def block_data(folder: Path) -> Any:
    path = folder / "block.yml"
    path.write_text(BLOCK)
    return read(path).data


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_mutated_data_are_accepted_or_refused(block_data: Any, data: st.DataObject) -> None:
    mutated = copy.deepcopy(block_data)
    if data.draw(st.booleans()):
        wall = {"on": "right", "gap": 0.1, "friction": {"smoothing": {"radius": 0.2}}}
        mutated["contact"] = [mutated["contact"], wall]
    for _ in range(data.draw(st.integers(1, 3))):
        spot = data.draw(st.sampled_from(_containers(mutated)))
        keys = list(spot) if isinstance(spot, dict) else list(range(len(spot)))
        if isinstance(spot, dict) and (not keys or data.draw(st.booleans())):
            spot[data.draw(WORDS)] = data.draw(VALUES)
        elif not keys:
            spot.append(data.draw(VALUES))
        else:
            spot[data.draw(st.sampled_from(keys))] = data.draw(VALUES)
    _accepted_or_refused(mutated)


@settings(max_examples=150, deadline=None)
@given(
    st.integers(0, len(BLOCK)),
    st.integers(0, 6),
    st.text("\"'&*!|>%@`{}[],:#?-\n\t x0.~<=\\\0é", max_size=6),
)
def test_mutated_text_is_accepted_or_refused(
    folder: Path, start: int, removed: int, inserted: str
) -> None:
    path = folder / "mutated.yml"
    path.write_text(BLOCK[:start] + inserted + BLOCK[start + removed :])
    try:
        load(path)
    except InputError as error:
        assert str(path) in str(error)
