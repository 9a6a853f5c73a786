"""The texts of the values of a key that varies: short, and different for different values."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_locking.study_file.parameters.wording import labels, told_apart
from contact_locking.view.report.page import shown

pytestmark = pytest.mark.serial

LIGHT = [{"on": "top", "value": [0, -0.01]}, {"on": "right", "value": [0, 0.001]}]
HEAVY = [{"on": "top", "value": [0, -0.02]}, {"on": "right", "value": [0, 0.001]}]
LEAVES = (
    st.none()
    | st.booleans()
    | st.integers(-3, 3)
    | st.floats(-1, 1)
    | st.text("ab{}: ,…", max_size=3)
)
VALUES = st.recursive(
    LEAVES,
    lambda inside: (
        st.lists(inside, max_size=5)
        | st.dictionaries(st.sampled_from(["on", "gap", "value", "norm"]), inside, max_size=3)
    ),
    max_leaves=12,
)


def test_the_label_of_a_case_names_every_key_that_varies() -> None:
    rows = [{"loads.tractions": load, "penalty.n": n} for load in (LIGHT, HEAVY) for n in (10, 20)]
    written = "[{on: top, value: [0, -0.01]}, {on: right, value: [0, 0.001]}]"
    assert labels(rows)[1] == f"loads.tractions = {written}, penalty.n = 20"
    assert len(set(labels(rows))) == 4


@settings(max_examples=100, deadline=None)
@given(values=st.lists(VALUES, max_size=6), writer=st.sampled_from([None, shown]))
def test_different_values_have_different_texts_and_equal_values_the_same(
    values: list[Any], writer: Any
) -> None:
    twice = [*values, *copy.deepcopy(values)]
    texts = told_apart(twice) if writer is None else told_apart(twice, writer)
    assert texts[: len(values)] == texts[len(values) :]
    told = list(zip(values, texts, strict=False))
    assert all(one == other for one, first in told for other, second in told if first == second)
    assert all(len(text) < 90 for text in texts)
