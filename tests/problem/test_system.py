"""What solves rely on: options of PETSc, linear algebra, iterations and callbacks."""

from __future__ import annotations

import numpy as np
import pytest
from problems import block, column

from contact_locking.monitor import Monitor
from contact_locking.running import solving


def test_petsc_options_of_the_caller_win_and_leave_no_trace() -> None:
    from petsc4py import PETSc

    solution = solving.solve(
        block(h=0.25, solver__petsc={"ksp_type": "gmres", "pc_type": "lu"}),
        petsc_options={"ksp_type": "fgmres"},
    )
    assert solution.converged
    assert not [key for key in PETSc.Options().getAll() if key.startswith("contact_locking")]


def test_unknown_petsc_factorisation_is_reported_and_not_a_crash() -> None:
    solution = solving.solve(block(h=0.25), petsc_options={"pc_factor_mat_solver_type": "nonsense"})
    assert not solution.converged
    assert "linear solve" in solution.summary["reason"]


def test_a_body_held_by_contact_alone_finds_its_place() -> None:
    solution = solving.solve(column(contact={"on": "bottom", "gap": 5.0}))
    assert solution.converged
    assert solution.summary["contact_force"][1] == pytest.approx(0.05, rel=1e-8)


@pytest.mark.serial
@pytest.mark.parametrize("method", ["penalty", "interior_point"])
def test_too_few_iterations_are_reported_with_what_was_reached(method: str) -> None:
    solution = solving.solve(block(penalty__n=1e6, solver={"method": method, "max_iterations": 2}))
    assert not solution.converged
    assert (
        "Newton steps" in solution.summary["reason"] or "2 interior" in solution.summary["reason"]
    )
    assert solution.summary["suggestion"]
    assert np.isfinite(solution.summary["compliance"])


@pytest.mark.serial
def test_friction_that_may_not_settle_is_reported() -> None:
    solution = solving.solve(block(solver={"method": "penalty", "max_friction_updates": 2}))
    assert not solution.converged
    assert "friction bound" in solution.summary["reason"]


@pytest.mark.serial
def test_an_error_in_a_callback_is_that_error_and_not_a_failed_solve() -> None:
    class Interrupting(Monitor):
        def iteration(self, k: int, residual: float) -> None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        solving.solve(block(h=0.25, solver={"method": "penalty"}), monitor=Interrupting())
