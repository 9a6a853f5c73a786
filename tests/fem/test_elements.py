"""An element is one object: quadratic displacements with limits at the corners, and another one."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import convergence
import numpy as np
import pytest
import ufl
from certified import work_of_stored_forces
from dolfinx import fem
from manufactured import Manufactured, rate
from mpi4py import MPI
from problems import block
from test_verification_manufactured import PLANE

from contact_locking.errors import InputError
from contact_locking.fem import compiled
from contact_locking.fem.spaces import P1, P2, Element
from contact_locking.laws.elasticity import strain
from contact_locking.problem.distance import distance
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.process.solving import solve_assembled
from contact_locking.results.solution import StudySolution
from contact_locking.running import writing
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

LIMIT = 0.02
VERTICES = {"quadrature_rule": "vertex", "quadrature_degree": 1}
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
def test_quadratic_displacements_are_nearer_at_as_many_unknowns(comm: MPI.Intracomm) -> None:
    reference = solved(benchmark(32), P2, comm)
    affine, quadratic = solved(benchmark(16), P1, comm), solved(benchmark(8), P2, comm)
    assert affine.summary["dofs"] == quadratic.summary["dofs"]
    errors = [convergence.distance(found, reference).v for found in (affine, quadratic)]
    assert errors[1] < 0.7 * errors[0]
    # From below: the limits at the corners of smaller cells leave more freedom.
    assert quadratic.summary["compliance"] < reference.summary["compliance"]


@pytest.mark.parametrize("n", [1e3, np.inf])
def test_the_stored_stresses_and_forces_do_the_work_of_the_loads(
    n: float, comm: MPI.Intracomm
) -> None:
    solution = solved(benchmark(8, penalty__n=n), P2, comm)
    assert solution.summary["contact_area"] > 0.5 and solution.summary["locked_fraction"] > 0.3
    dx = ufl.Measure("dx", domain=solution.domain.mesh, metadata=VERTICES)
    work = work_of_stored_forces(solution, dx)
    assert work == pytest.approx(solution.summary["compliance"], rel=1e-8)


def test_the_control_points_of_an_edge_have_equal_weights(comm: MPI.Intracomm) -> None:
    problem = assemble(benchmark(4), comm, element=P2)
    (contact,) = problem.contacts
    surface = contact.surface
    place = 8.0 * surface.points[:, 0]
    ends = np.isclose(place, 0.0) | np.isclose(place, 8.0)
    wanted = np.where(np.isclose(place % 2.0, 1.0) | ends, 1.0, 2.0) / 12.0
    assert surface.weights == pytest.approx(wanted)
    assert len(surface.whole().facets) == 8
    assert surface.whole().edges.data == pytest.approx(1.0 / 8.0)
    problem.close()


@pytest.mark.serial
def test_contact_points_follow_gamma_c_node_by_node(comm: MPI.Intracomm) -> None:
    solution = solved(benchmark(4), P2, comm)
    points, facets = solution.contact_points, solution.contact_facets
    assert points is not None and facets is not None
    assert points.x[:, 0] == pytest.approx(np.arange(9) / 8.0)
    assert np.array_equal(facets, np.column_stack([np.arange(8), np.arange(1, 9)]))


@pytest.mark.serial
def test_a_smooth_elastic_field_converges_by_one_order_more(comm: MPI.Intracomm) -> None:
    sizes = [1 / 4, 1 / 8, 1 / 16]
    given = Manufactured(PLANE, element=P2)
    errors = [given.errors(given.solved(h)) for h in sizes]
    assert rate(sizes, [e.v for e in errors]) == pytest.approx(2.0, abs=0.05)
    assert rate(sizes, [e.l2 for e in errors]) == pytest.approx(3.0, abs=0.1)


def test_quadratic_displacements_of_an_affine_material_are_found(comm: MPI.Intracomm) -> None:
    # E = 1 + x and lambda = mu = 0.4 E: the stress of u = (x^2, x y)/100 has this divergence.
    sides, exact = ["left", "right", "top", "bottom"], ["0.01*x*x", "0.01*x*y"]
    loads = {
        "displacements": [{"on": sides, "value": exact}],
        "body_force": ["-0.01*(3.2 + 6*x)", "-0.004*y"],
    }
    elasticity = {"young": "1 + x", "poisson": 0.25}
    material = {"elasticity": elasticity, "locking_limit": float("inf")}
    parameters = block(2, 0.3, contact__on=[], loads=loads, material=material)
    u = solved(parameters, P2, comm).displacement
    found = u.x.array.copy()
    u.interpolate(lambda x: 0.01 * np.vstack([x[0] ** 2, x[0] * x[1]]))
    assert np.abs(found - u.x.array).max() <= 1e-14


@pytest.mark.serial
def test_the_penalty_bound_holds_for_quadratic_displacements(comm: MPI.Intracomm) -> None:
    exact = solved(benchmark(8, friction__coefficient=0.0), P2, comm)
    problem = assemble(benchmark(8, friction__coefficient=0.0, penalty__n=1e3), comm, element=P2)
    data = problem.data
    penalised = solve_assembled(problem)
    bound = penalised.summary["certificate"]["errors"]["penalty"]["energy_norm"]
    apart = distance(penalised.displacement, exact.displacement, data)["energy_norm"]
    assert 0.0 < apart <= bound


@pytest.mark.skipif(checkpoint.unavailable() is not None, reason=str(checkpoint.unavailable()))
def test_a_checkpoint_belongs_to_its_element(comm: MPI.Intracomm, tmp_path: Path) -> None:
    folder = comm.bcast(tmp_path)
    solution = solved(benchmark(4), P2, comm)
    writing.save(solution, folder)
    again = solve_assembled(assemble(benchmark(4), comm, element=P2), restart=folder)
    assert again.converged and again.summary["iterations"]["tangents"] == 0
    assert again.summary["compliance"] == pytest.approx(solution.summary["compliance"], rel=1e-12)
    with pytest.raises(InputError, match="the checkpoint has 2, and the study has 1"):
        solve_assembled(assemble(benchmark(4), comm), restart=folder)


def test_another_element_is_another_object(comm: MPI.Intracomm) -> None:
    solution = solved(benchmark(8), MIDPOINTS, comm)
    assert solution.summary["strain_norm_max"] == pytest.approx(LIMIT, rel=1e-6)
    assert largest_strain(solution) > 2.0 * LIMIT
