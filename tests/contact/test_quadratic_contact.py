"""Contact with quadratic elements: control values of the trace, their weights, and their forces."""

from __future__ import annotations

import dataclasses
from typing import Any

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
from contact_locking.fem.spaces import P2, Trace
from contact_locking.parallel import maximum
from contact_locking.results.solution import StudySolution
from contact_locking.running.assembly import assemble
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


@pytest.mark.serial
def test_an_element_without_points_on_faces_has_no_contact_in_space(comm: MPI.Intracomm) -> None:
    with pytest.raises(InputError, match="no contact in 3 dimensions for these elements"):
        assemble(block(3, 0.5), comm, element=SIMPSON)
