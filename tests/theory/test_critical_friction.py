"""Critical friction against a formula, and against eigenvalues of an assembly of its own."""

from __future__ import annotations

import math
from typing import Any

import basix.ufl
import numpy as np
import pytest
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from sweep.case import clamp, study
from sweep.solve import judge_of

import contact_locking as cl
from contact_locking.arrays import FloatArray
from contact_locking.results.contact_points import OPEN, SLIP
from contact_locking.results.output import Extras
from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

MU = 0.05
# The last edge is held, and the first corner is on the floor.
CORNERS = np.array([[0.0, 0.0], [0.2, 1.0], [1.2, 1.6]])


def _stiffness() -> FloatArray:
    """The stiffness (2, 2) of the corner on the floor, for E = 1 and nu = 0.3."""
    bulk, shear = 0.3 / (1.3 * 0.4), 1.0 / 2.6
    edges = CORNERS[1:] - CORNERS[0]
    area = 0.5 * abs(float(np.linalg.det(edges)))
    slope = -np.linalg.solve(edges, np.ones(2))
    outer = np.outer(slope, slope)
    return np.asarray(area * ((bulk + shear) * outer + shear * slope @ slope * np.eye(2)))


def _sliding_triangle(push: float) -> dict[str, Any]:
    """What is said of a triangle whose corner is pressed on the floor and pushed along it."""
    element = basix.ufl.element("Lagrange", "triangle", 1, shape=(2,))
    cells = np.array([[0, 1, 2]])
    body = mesh.create_mesh(comm=MPI.COMM_SELF, cells=cells, x=CORNERS, e=element)
    space = fem.functionspace(body, ("Lagrange", 1, (2,)))
    on_floor = mesh.locate_entities(body, 0, lambda x: np.isclose(x[1], 0.0))
    for dimensions in ((0, 1), (1, 2)):
        body.topology.create_connectivity(*dimensions)
    sides = body.topology.connectivity(0, 1).links(int(on_floor[0]))
    held = np.setdiff1d(np.arange(3, dtype=np.int32), sides)
    fixed = fem.locate_dofs_topological(space, 1, held)
    problem = cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.3),
        ufl.inner(ufl.as_vector((push, -0.3)), ufl.TestFunction(space)) * ufl.dx,
        [fem.dirichletbc(np.zeros(2), fixed, space)],
        contacts=[
            cl.Contact(sides, cl.HalfSpace((0.0, 0.0), (0.0, 1.0)), cl.Coulomb(MU, cl.Local()))
        ],
        space=space,
    )
    solution = problem.solve(extras=Extras(critical_friction=True))
    problem.close()
    assert solution.converged
    (fields,) = solution.contacts
    assert np.sum(fields.state == SLIP) == 1
    found: dict[str, Any] = solution.summary["certificate"]["critical_friction"]
    return found


def test_one_corner_is_critical_where_friction_is_as_stiff_as_the_body() -> None:
    """``K_tt u_t = f_t + mu (K_nt u_t - f_n)`` is singular for ``mu = K_tt/K_nt``.

    Here n points down, and the corner slides to the side where that mu is positive.
    """
    stiffness = _stiffness()
    critical = stiffness[0, 0] / abs(stiffness[0, 1])
    found = [_sliding_triangle(push) for push in (-0.1, 0.1)]
    shares = [entry["share"] for entry in found]
    assert shares.count(None) == 1
    (entry,) = (item for item in found if item["share"] is not None)
    assert entry["share"] == pytest.approx(critical / MU, rel=1e-6)
    assert entry["coefficient"] == pytest.approx(critical, rel=1e-6)
    assert entry["mode_peak"] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_a_sliding_block_has_the_eigenvalue_of_a_dense_assembly() -> None:
    """The pressure that answers a traction where points slip, by a Schur complement in NumPy."""
    data = study(
        {"builder": "block", "dim": 2, "size": [2.0, 0.5], "h": 0.125, "structured": True},
        {"displacements": [{"on": "top", "value": [0.2, -0.01]}]},
        friction=0.8,
        smoothing={"kernel": "none"},
    )
    data["certificate"] = {"critical_friction": True}
    problem = assemble(Parameters.model_validate(data), MPI.COMM_SELF)
    judge = judge_of(problem, data)
    (contact,) = judge.contacts
    solution = solve_assembled(problem)
    (fields,) = solution.contacts
    order = np.argsort(fields.surface.blocks)
    state, slip = fields.state[order], fields.increment[order, 0]
    slips, closed = np.flatnonzero(state == SLIP), np.flatnonzero(state != OPEN)
    assert len(slips) > 8
    free = np.einsum("kii->ki", judge.body.free).ravel() > 0.5
    normal, along = 2 * contact.nodes + 1, 2 * contact.nodes
    free[normal[closed]] = False
    free[along[(state != SLIP) & (state != OPEN)]] = False
    stiffness, weights = judge.body.matrix.toarray(), contact.weights
    forces = np.zeros((len(free), len(slips)))
    forces[along[slips], np.arange(len(slips))] = -np.sign(slip[slips]) * weights[slips]
    moved = np.zeros_like(forces)
    moved[free] = np.linalg.solve(stiffness[np.ix_(free, free)], forces[free])
    # The floor is below: a reaction upwards is a pressure.
    pressures = (stiffness @ moved)[normal[slips]] / weights[slips, None]
    largest = max(value.real for value in np.linalg.eigvals(pressures) if value.imag == 0.0)
    found = solution.summary["certificate"]["critical_friction"]
    assert found["coefficient"] == pytest.approx(1.0 / largest, rel=1e-5)
    assert found["share"] == pytest.approx(found["coefficient"] / 0.8)


def test_without_friction_or_without_a_support_the_entry_says_why() -> None:
    data = study(
        {"builder": "block", "dim": 2, "h": 0.5, "structured": True}, {"displacements": [clamp(2)]}
    )
    data["certificate"] = {"critical_friction": True}
    solution = solve_assembled(assemble(Parameters.model_validate(data), MPI.COMM_SELF))
    found = solution.summary["certificate"]["critical_friction"]
    assert found["share"] is None
    assert "there is no friction" in found["reason"]
    assert not math.isnan(solution.summary["residual"])


@pytest.mark.parametrize("poisson", [0.1, 0.3, 0.4])
def test_no_friction_is_critical_where_all_points_stick(poisson: float) -> None:
    """The map of friction bounds does not depend on them: its derivative is zero."""
    data = study(
        {"builder": "block", "dim": 2, "h": 0.25, "structured": True},
        {"displacements": [{"on": "top", "value": [0.002, -0.01]}]},
        poisson=poisson,
        friction=1.0,
        smoothing={"kernel": "none"},
    )
    data["certificate"] = {"critical_friction": True}
    solution = solve_assembled(assemble(Parameters.model_validate(data), MPI.COMM_SELF))
    (fields,) = solution.contacts
    assert not np.any(fields.state == SLIP)
    assert solution.summary["certificate"]["critical_friction"]["share"] is None
