"""What is found from values that are spread over the ranks."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.parallel import exceeded_by_few
from contact_locking.solver.interior_point.cones import Step
from contact_locking.solver.interior_point.family import Direction
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.iterate import Iterate

WORLD = MPI.COMM_WORLD


def mine(values: list[float]) -> FloatArray:
    """This rank's share of values."""
    return np.array(values[WORLD.rank :: WORLD.size])


@pytest.mark.parametrize(
    ("few", "expected"), [(0, 90.0), (1, 7.0), (2, 7.0), (3, 4.0), (4, 1.0), (9, 1.0)]
)
def test_no_more_than_a_few_values_exceed_the_number_found(few: int, expected: float) -> None:
    values = mine([0.5, 90.0, 7.0, -3.0, 7.0, 4.0])
    found = exceeded_by_few(WORLD, values, few, 1.0)
    assert found == pytest.approx(expected, rel=1e-5)
    assert WORLD.allreduce(int(np.sum(values > found))) <= few


def test_no_values_exceed_the_least_number() -> None:
    assert exceeded_by_few(WORLD, mine([]), 0, 2.0) == 2.0


def test_infinite_values_are_exceeded_by_none() -> None:
    values = mine([math.inf, math.inf, 3.0])
    assert exceeded_by_few(WORLD, values, 1, 1.0) == math.inf
    assert exceeded_by_few(WORLD, values, 2, 1.0) < 3.001


def test_values_that_are_no_numbers_count_as_small() -> None:
    assert exceeded_by_few(WORLD, mine([math.nan, 2.0, math.nan]), 1, 1.0) == 1.0


class Lines(HalfLines):
    """Half lines that a step of -1 leaves at these lengths, on this rank."""

    takes_part, compliance = True, 0.0

    def __init__(self, lengths: FloatArray) -> None:
        self.weights, self.x, self.z = np.ones_like(lengths), lengths, np.ones_like(lengths)


@pytest.mark.parametrize(
    ("share", "expected"), [(0.0, 0.1), (0.009, 0.1), (0.01, 0.2), (0.02, 0.5), (0.04, 1.0)]
)
def test_a_share_of_the_cones_of_all_families_and_ranks_may_be_left_behind(
    share: float, expected: float
) -> None:
    families = [Lines(mine([0.1, 0.5, 0.7] + 47 * [2.0])), Lines(mine([0.2] + 49 * [9.0]))]
    tangent: Any = SimpleNamespace(families=families, comm=WORLD)
    iterate = Iterate(tangent, (0.1, 10.0))
    still = np.zeros_like(iterate.cones.reactions)
    direction = Direction(still, Step(still - 1.0, still), iterate.cones)
    length = iterate.longest_step_of_most(direction, share)
    assert length == pytest.approx(expected, rel=1e-5)
