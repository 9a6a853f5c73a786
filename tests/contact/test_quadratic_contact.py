"""Contact with quadratic elements: control values of the trace, their weights, and their forces."""

from __future__ import annotations

import dataclasses
from typing import Any

import convergence
import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import block
from slow import slow
from test_elements import solved

from contact_locking.errors import InputError
from contact_locking.fem import compiled
from contact_locking.fem.compiled import integral
from contact_locking.fem.spaces import P2
from contact_locking.fem.trace import Trace, make_nodal
from contact_locking.parallel import maximum
from contact_locking.results.solution import StudySolution
from contact_locking.study.assembly import StudyProblem, assemble
from contact_locking.study_file.parameters import Parameters

#: Contact at the nodes of edges with the weights of Simpson's rule.
SIMPSON = dataclasses.replace(
    P2,
    trace=Trace(
        rules={2: {"quadrature_rule": "GLL", "quadrature_degree": 3}},
        pieces={2: P2.trace.pieces[2]},
    ),
)

#: The slope of the foundation of :func:`pressed`.
SLOPE = 0.02
DIMENSIONS = pytest.mark.parametrize("dim", [2, 3])


def assembled(dim: int, comm: MPI.Intracomm) -> StudyProblem:
    return assemble(block(dim, 0.5), comm, element=P2)


def random_field(problem: StudyProblem) -> fem.Function:
    """A field with the same random nodal values for every distribution."""
    field = fem.Function(problem.u.function_space)
    dim = problem.domain.dim
    waves = np.random.default_rng(7).normal(size=(3, dim, dim)) * 9.0
    field.interpolate(lambda x: sum(np.sin(wave @ x[:dim]) for wave in waves))
    return field


@DIMENSIONS
def test_the_weights_are_the_integrals_of_the_control_functions(
    dim: int, comm: MPI.Intracomm
) -> None:
    problem = assembled(dim, comm)
    (contact,) = problem.contacts
    surface = contact.surface
    assert np.all(surface.weights > 0.0)
    assert surface.integral(np.ones(len(surface.nodes))) == pytest.approx(1.0)
    field = random_field(problem)
    summed = surface.integral(surface.limited.of_function(field))
    measure = problem.domain.ds(contact.on, None)
    exact = [integral(problem.domain, component * measure) for component in ufl.split(field)]
    assert summed == pytest.approx(exact, rel=1e-12)
    problem.close()


@DIMENSIONS
def test_the_control_values_in_ufl_are_those_of_the_matrix(dim: int, comm: MPI.Intracomm) -> None:
    problem = assembled(dim, comm)
    (contact,) = problem.contacts
    field = random_field(problem)
    limited = contact.surface.limited
    by_form = contact.surface.average(contact.limited(field))()
    assert by_form == pytest.approx(limited.of_function(field), abs=1e-12)
    problem.close()


@DIMENSIONS
def test_nodal_values_have_the_control_values_that_they_were_made_from(
    dim: int, comm: MPI.Intracomm
) -> None:
    problem = assembled(dim, comm)
    (contact,) = problem.contacts
    surface = contact.surface
    wanted = np.cos(20.0 * surface.points)
    field = surface.vector_function(wanted)
    make_nodal(field, [surface.limited])
    assert surface.limited.of_function(field) == pytest.approx(wanted, abs=1e-14)
    problem.close()


@DIMENSIONS
def test_affine_fields_are_their_control_values(dim: int, comm: MPI.Intracomm) -> None:
    problem = assembled(dim, comm)
    surface = problem.contacts[0].surface
    field = fem.Function(problem.u.function_space)
    field.interpolate(lambda x: x[:dim])
    assert surface.limited.of_function(field) == pytest.approx(surface.points, abs=1e-15)
    problem.close()


@DIMENSIONS
def test_friction_of_control_values_bounds_the_integral_from_above(
    dim: int, comm: MPI.Intracomm
) -> None:
    problem = assembled(dim, comm)
    (contact,) = problem.contacts
    field = random_field(problem)
    summed = contact.surface.integral(np.linalg.norm(contact.split(field)[1], axis=1))
    slip = field - field[dim - 1] * ufl.as_vector([0.0] * (dim - 1) + [1.0])
    measure = problem.domain.ds(contact.on, None, quadrature_degree=16)
    exact = integral(problem.domain, ufl.sqrt(ufl.inner(slip, slip)) * measure)
    assert exact < summed < 3.0 * exact
    problem.close()


def entered(solution: StudySolution) -> float:
    """``max u_nu - gap`` over a fine lattice of points of the flat bottom; collective."""
    u = solution.displacement
    mesh, dim = u.function_space.mesh, u.ufl_shape[0]
    # The nodes of a higher degree are a lattice.
    fine = fem.Function(fem.functionspace(mesh, ("P", 12 if dim == 2 else 6)))
    depth = -u[dim - 1] - SLOPE * ufl.SpatialCoordinate(mesh)[0]
    fine.interpolate(compiled.interpolation(depth, fine.function_space))
    bottom = fem.locate_dofs_geometrical(fine.function_space, lambda x: np.isclose(x[dim - 1], 0.0))
    return maximum(mesh.comm, fine.x.array[bottom])


def pressed(dim: int, **changes: Any) -> Parameters:
    """A block with a clamped side, which the load on its top bends onto a tilted foundation."""
    contact = {"on": "bottom", "gap": f"{SLOPE}*x"}
    h = 0.25 if dim == 2 else 0.5
    return block(dim, h, penalty__n=np.inf, contact=contact, **changes)


@DIMENSIONS
def test_the_displacement_keeps_the_gap_everywhere_on_a_flat_side(
    dim: int, comm: MPI.Intracomm
) -> None:
    solution = solved(pressed(dim), P2, comm)
    assert entered(solution) <= 1e-9
    assert solution.summary["contact_area"] > 0.3


@pytest.mark.serial
def test_contact_at_nodes_lets_edges_enter_between_nodes(comm: MPI.Intracomm) -> None:
    assert entered(solved(pressed(2), SIMPSON, comm)) > 1e-5


@pytest.mark.parametrize(
    ("dim", "kernel"),
    [
        (2, "convolution"),
        slow(2, "helmholtz"),
        slow(3, "convolution"),
        (3, "helmholtz"),
    ],
)
def test_forces_of_the_table_and_of_the_fields_balance_the_reactions(
    dim: int, kernel: str, comm: MPI.Intracomm
) -> None:
    changes = {"friction__smoothing": {"kernel": kernel, "radius": 0.5}}
    solution = solved(pressed(dim, **changes), P2, comm)
    certificate = solution.summary["certificate"]
    assert all(item["holds"] for item in certificate["criteria"].values())
    (contact,) = solution.contacts
    total = np.add(solution.summary["contact_force"], solution.summary["friction_force"])
    assert np.linalg.norm(total) > 0.01
    measure = solution.domain.ds(contact.contact.on, None)
    normal = ufl.FacetNormal(solution.domain.mesh)
    fields = solution.tangential_traction - solution.contact_pressure * normal
    assert [integral(solution.domain, fields[i] * measure) for i in range(dim)] == pytest.approx(
        total, abs=1e-12
    )
    resultants = certificate["resultants"]
    assert resultants["contact"] == pytest.approx(total, abs=1e-12)
    assert np.add(resultants["loads"], resultants["reactions"]) == pytest.approx(-total, abs=1e-8)


@pytest.mark.parametrize("dim", [2, slow(3)])
def test_newton_finds_the_solution_of_the_interior_point_method(
    dim: int, comm: MPI.Intracomm
) -> None:
    found = [
        solved(block(dim, 0.5, solver__method=method), P2, comm)
        for method in ("newton", "interior_point")
    ]
    assert convergence.distance(*found).v <= 1e-6
    assert found[0].summary["contact_area"] > 0.3


def test_the_fields_of_two_contacts_with_a_common_edge_add_up(comm: MPI.Intracomm) -> None:
    contact = [{"on": "bottom"}, {"on": "back", "friction": {"coefficient": 0.0}}]
    loads = {
        "tractions": [
            {"on": "top", "value": [0.01, 0.0, -0.05]},
            {"on": "front", "value": [0.0, 0.04, 0.0]},
        ],
        "displacements": [{"on": "left", "value": [0.0, 0.0, 0.0]}],
    }
    solution = solved(block(3, 0.5, penalty__n=np.inf, contact=contact, loads=loads), P2, comm)
    sums = [float(one.surface.integral(one.pressure)) for one in solution.contacts]
    assert min(sums) > 0.01
    measure = solution.domain.ds(("bottom", "back"), None)
    total = integral(solution.domain, solution.contact_pressure * measure)
    assert total == pytest.approx(sum(sums), rel=1e-12)


@pytest.mark.serial
def test_an_element_without_points_on_faces_has_no_contact_in_space(comm: MPI.Intracomm) -> None:
    with pytest.raises(InputError, match="no contact in 3 dimensions for these elements"):
        assemble(block(3, 0.5), comm, element=SIMPSON)
