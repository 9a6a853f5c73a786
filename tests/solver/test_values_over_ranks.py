"""What is found from values that are spread over the ranks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.iterate import Iterate

WORLD = MPI.COMM_WORLD


def mine(values: list[float]) -> FloatArray:
    """This rank's share of values."""
    return np.array(values[WORLD.rank :: WORLD.size])


@dataclass(eq=False)
class Cones:
    """A family of cones that a step leaves at these lengths, on this rank."""

    lengths: FloatArray
    takes_part: bool = True
    scale: float = 1.0

    @property
    def weights(self) -> FloatArray:
        return np.ones_like(self.lengths)

    def speeds(self, step: None) -> FloatArray:
        return np.reciprocal(self.lengths)

    def longest_step(self, step: None) -> float:
        return float(np.min(self.lengths, initial=math.inf))


@pytest.mark.parametrize(
    ("share", "expected"), [(0.0, 0.1), (0.009, 0.1), (0.01, 0.2), (0.02, 0.5), (0.04, 1.0)]
)
def test_a_share_of_the_cones_of_all_families_and_ranks_may_be_left_behind(
    share: float, expected: float
) -> None:
    families: list[Any] = [
        Cones(mine([0.1, 0.5, 0.7] + 47 * [2.0])),
        Cones(mine([0.2] + 49 * [9.0])),
    ]
    tangent: Any = SimpleNamespace(families=families, comm=WORLD)
    direction: Any = SimpleNamespace(steps=dict.fromkeys(families))
    length = Iterate(tangent, (0.1, 10.0)).longest_step_of_most(direction, share)
    assert length == pytest.approx(expected, rel=1e-5)
