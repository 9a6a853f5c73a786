"""What is found from values that are spread over the ranks."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.cones import Step
from contact_locking.solver.interior_point.family import Direction
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.iterate import Iterate

WORLD = MPI.COMM_WORLD


def mine(values: list[float]) -> FloatArray:
    """This rank's share of values."""
    return np.array(values[WORLD.rank :: WORLD.size])


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
