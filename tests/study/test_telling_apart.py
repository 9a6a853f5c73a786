"""The texts of the values of a key that varies: short, and different for different values."""

from __future__ import annotations

import copy
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contact_locking.study_file.parameters.wording import labels, told_apart
from contact_locking.view.report.words import shown

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


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([100.0, float("inf"), "newton", None], ["100", ".inf", "newton", "null"]),
        ([[0, -0.1], [0, -0.2]], ["[0, -0.1]", "[0, -0.2]"]),
        ([{"E": 1, "nu": 0.3}, {"E": 2.0, "nu": 0.3}], ["{E: 1, …}", "{E: 2, …}"]),
        ([LIGHT, HEAVY], [f"[{{on: top, value: [0, -0.0{load}]}}, …]" for load in (1, 2)]),
        ([LIGHT, LIGHT[:1]], ["[…, {on: right, value: [0, 0.001]}]", "[…]"]),
        ([LIGHT[1:], []], ["[{on: right, value: [0, 0.001]}]", "[]"]),
        ([[1, 2, 3, 4, 5], [1, 2, 9, 4, 5]], ["[…, 3, …]", "[…, 9, …]"]),
        ([{"on": "bottom", "gap": 0}, {"on": "bottom"}], ["{on: bottom, gap: 0}", "{on: bottom}"]),
        ([1, True, 1.0, "1"], ["1", "true", "1", "'1'"]),
    ],
)  # fmt: skip
def test_of_lists_and_mappings_only_what_differs_is_told(
    values: list[Any], texts: list[str]
) -> None:
    assert told_apart(values) == texts


def test_numbers_that_are_rounded_to_the_same_text_are_told_in_full() -> None:
    assert told_apart([0.25, 1e-5], shown) == ["0.25", "10⁻⁵"]
    assert told_apart([0.1234561, 0.1234562], shown) == ["0.1234561", "0.1234562"]


def test_long_values_are_cut_and_numbered_where_the_difference_is_cut_off() -> None:
    begin = "x" * 100
    first, second = told_apart([f"{begin}+1", f"{begin}+2"])
    assert first.endswith("… (value 1)") and second.endswith("… (value 2)")
    assert len(first) < 90


def test_the_label_of_a_case_names_every_key_that_varies() -> None:
    rows = [{"loads.tractions": load, "penalty.n": n} for load in (LIGHT, HEAVY) for n in (10, 20)]
    assert labels(rows)[1] == "loads.tractions = [{on: top, value: [0, -0.01]}, …], penalty.n = 20"
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
