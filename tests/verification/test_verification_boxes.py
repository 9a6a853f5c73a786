"""V11 on quadrilaterals and hexahedra: computed beside known answers."""

from __future__ import annotations

import dataclasses

import pytest
from manufactured import rate
from test_verification_manufactured import problem_of
from verification_table import Rows

from contact_locking.fem.spaces import Q1


@pytest.mark.serial
@pytest.mark.parametrize("name", ["locking", "contact", "friction", "all together"])
def test_v11_quadrilaterals_converge_at_the_optimal_rate(name: str, found: Rows) -> None:
    given, sizes = dataclasses.replace(problem_of(name), element=Q1), [1 / 8, 1 / 16, 1 / 32]
    norms = [given.errors(given.solved(h)) for h in sizes]
    where = f"manufactured, 2D, Q1: {name}"
    for norm, wanted in (("V", 1.0), ("L2", 2.0)):
        measured = rate(sizes, [getattr(e, norm.lower()) for e in norms])
        found.add("V11", where, f"rate in {norm}, optimal", measured, wanted)
        assert measured > wanted - 0.15


@pytest.mark.serial
@pytest.mark.serial
def test_v11_hexahedra_converge_at_the_optimal_rate(found: Rows) -> None:
    given, sizes = dataclasses.replace(problem_of("all together", 3), element=Q1), [1 / 4, 1 / 8]
    norms = [given.errors(given.solved(h)) for h in sizes]
    where = "manufactured, 3D, Q1: all together"
    for norm, wanted in (("V", 1.0), ("L2", 2.0)):
        measured = rate(sizes, [getattr(e, norm.lower()) for e in norms])
        found.add("V11", where, f"rate in {norm}, optimal", measured, wanted)
        assert measured > wanted - 0.15
