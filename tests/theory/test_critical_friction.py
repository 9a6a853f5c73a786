"""Critical friction against a formula, and against eigenvalues of an assembly of its own."""

from __future__ import annotations

import math

import numpy as np
import pytest
from mpi4py import MPI
from sweep.case import clamp, study
from sweep.solve import judge_of

from contact_locking.results.contact_points import OPEN, SLIP
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial


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
    assert found["share"] is None and found["reason"]
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
