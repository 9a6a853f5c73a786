"""The cheapest of the golden problems; `make golden` solves all of them."""

from __future__ import annotations

import itertools

import pytest

from golden.numbers import NUMBERS, PROBLEMS, differences, numbers_of, read

# One problem in so many of each kind.
SHARE = 10

_GOLDEN, _PROBLEMS = read(NUMBERS), read(PROBLEMS)


def cheapest() -> list[str]:
    """Of each kind the problems that are solved fastest."""
    names = []
    for kind, group in itertools.groupby(sorted(_GOLDEN), lambda name: name.split("/")[0]):
        if kind != "verification":
            ordered = sorted(group, key=lambda name: (_GOLDEN[name]["seconds"], name))
            names += ordered[: -(-len(ordered) // SHARE)]
    return names


@pytest.mark.serial
@pytest.mark.parametrize("name", cheapest())
def test_the_numbers_of_cheap_problems_are_golden(name: str) -> None:
    numbers = numbers_of(_PROBLEMS[name], _GOLDEN[name]["seconds"])
    assert differences(_GOLDEN[name], numbers) == []


def test_all_golden_problems_have_numbers() -> None:
    assert sorted(_PROBLEMS) == sorted(_GOLDEN)


def test_a_force_off_by_two_millionths_and_two_tangents_differ() -> None:
    golden = {"outcome": "converged", "scale": 2.0, "forces": {"a": [2.0, 0.0]}, "tangents": [5]}
    near = golden | {"forces": {"a": [2.0, 1.9e-6]}, "tangents": [6]}
    far = golden | {"forces": {"a": [2.0, 2.1e-6]}, "tangents": [7]}
    assert differences(golden, near) == []
    assert [row[0] for row in differences(golden, far)] == ["forces: a", "tangents"]
    assert differences(golden, {"outcome": "infeasible"}) == [
        ("outcome", "converged", "infeasible")
    ]
