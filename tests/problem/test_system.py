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


def test_iterative_and_direct_linear_algebra_agree() -> None:
    direct, iterative = (
        solving.solve(block(3, 0.34, solver={"linear": name})) for name in ("direct", "iterative")
    )
    assert direct.converged and iterative.converged
    assert iterative.summary["iterations"]["linear"] > iterative.summary["iterations"]["tangents"]
    # With CG the duality gap that is left is 1e-8 of the elastic energy.
    assert iterative.summary["compliance"] == pytest.approx(direct.summary["compliance"], rel=2e-8)


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


def test_equilibrium_of_forces_on_the_whole_body() -> None:
    # Without Gamma_D in x, loads and contact alone must balance vertically.
    solution = solving.solve(column(friction={"coefficient": 0.3}))
    assert solution.summary["contact_force"] == pytest.approx([0.0, 0.05], abs=1e-9)
