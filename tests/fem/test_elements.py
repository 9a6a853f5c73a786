"""An element is one object: quadratic displacements with limits at the corners, and another one."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from manufactured import Manufactured, rate
from mpi4py import MPI
from problems import block
from test_verification_manufactured import PLANE

from contact_locking.fem import compiled
from contact_locking.fem.spaces import P2, Element
from contact_locking.laws.body import strain
from contact_locking.results.solution import StudySolution
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled
from contact_locking.study_file.parameters import Parameters

LIMIT = 0.02
#: One cone at the midpoint of each cell says little of a strain that is affine in the cell.
MIDPOINTS = dataclasses.replace(P2, strain_degree=0, locking_rule={"quadrature_degree": 1})


def benchmark(divisions: int, **changes: Any) -> Parameters:
    """The model case on a regular grid, clamped on the right and pulled to the left.

    Seen from the clamped side the diagonals of the cells go up, which on coarse grids is the worse
    of both ways.
    """
    changes = {"penalty__n": np.inf, "friction__smoothing__radius": 0.1, **changes}
    loads = {
        "tractions": [{"on": "top", "value": [-0.03, -0.05]}],
        "displacements": [{"on": "right", "value": [0.0, 0.0]}],
    }
    return block(2, 1.0 / divisions, mesh__structured=True, loads=loads, **changes)


def solved(parameters: Parameters, element: Element, comm: MPI.Intracomm) -> StudySolution:
    solution = solve_assembled(assemble(parameters, comm, element=element))
    assert solution.converged, solution.summary["reason"]
    return solution


def largest_strain(solution: StudySolution) -> float:
    """At the points of a fine lattice in every cell; collective."""
    eps = strain(solution.displacement)
    space = fem.functionspace(solution.domain.mesh, ("DG", 4))
    size = fem.Function(space)
    size.interpolate(compiled.interpolation(ufl.sqrt(ufl.inner(eps, eps)), space))
    local = float(size.x.array.max(initial=0.0))
    return float(solution.domain.comm.allreduce(local, op=MPI.MAX))


@pytest.mark.parametrize(
    ("divisions", "compliance"),
    [
        (8, 8.54e-4),
        pytest.param(16, 8.69e-4, marks=pytest.mark.serial),
        pytest.param(32, 8.77e-4, marks=pytest.mark.serial),
    ],
)
def test_quadratic_displacements_keep_the_limit_everywhere(
    divisions: int, compliance: float, comm: MPI.Intracomm
) -> None:
    solution = solved(benchmark(divisions), P2, comm)
    free = 2 * (2 * divisions) * (2 * divisions + 1)
    assert solution.summary["dofs"] == free + 2 * (2 * divisions + 1)
    assert LIMIT * (1.0 - 1e-6) < largest_strain(solution) <= LIMIT * (1.0 + 1e-9)
    # Of an implementation of its own, to the digits that were noted.
    assert solution.summary["compliance"] == pytest.approx(compliance, abs=0.006e-4)


@pytest.mark.serial
def test_a_smooth_elastic_field_converges_by_one_order_more(comm: MPI.Intracomm) -> None:
    sizes = [1 / 4, 1 / 8, 1 / 16]
    given = Manufactured(PLANE, element=P2)
    errors = [given.errors(given.solved(h)) for h in sizes]
    assert rate(sizes, [e.v for e in errors]) == pytest.approx(2.0, abs=0.05)
    assert rate(sizes, [e.l2 for e in errors]) == pytest.approx(3.0, abs=0.1)


def test_another_element_is_another_object(comm: MPI.Intracomm) -> None:
    solution = solved(benchmark(8), MIDPOINTS, comm)
    assert solution.summary["strain_norm_max"] == pytest.approx(LIMIT, rel=1e-6)
    assert largest_strain(solution) > 2.0 * LIMIT
