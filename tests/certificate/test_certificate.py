"""The criteria of the certificate hold for good solutions, and catch planted defects."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from certified import certificate
from mpi4py import MPI
from problems import block

from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import certify
from contact_locking.contact.coulomb import ConvolutionOperator
from contact_locking.laws.body import normal_part, positive_part, unit_ball_excess
from contact_locking.penalty_method import equations
from contact_locking.process import problem_solver
from contact_locking.running import solving

Tamper = Callable[[SolvedState], None]


# Planted defects ----------------------------------------------------------------------------------


def friction_pushes(state: SolvedState) -> None:
    (contact,) = state.contacts
    contact.traction = 0.0 - contact.traction


def half_the_locking_stress(state: SolvedState) -> None:
    state.body.locking_stress.x.array[:] *= 0.5


def pressure_pulls(state: SolvedState) -> None:
    (contact,) = state.contacts
    contact.pressure = 0.0 - contact.pressure


def old_bound(state: SolvedState) -> None:
    (contact,) = state.contacts
    contact.bound = 1.01 * contact.bound


def too_much_friction(state: SolvedState) -> None:
    (contact,) = state.contacts
    contact.traction = 20.0 * contact.traction


def pressure_moves_aside(state: SolvedState) -> None:
    """The resultant keeps its size and changes its position."""
    (contact,) = state.contacts
    weights = contact.surface.weights
    total = state.sum(weights * contact.pressure)
    contact.pressure = np.full_like(weights, total / state.sum(weights))


@pytest.mark.serial
@pytest.mark.parametrize("n", [1e3, math.inf])
@pytest.mark.parametrize(
    ("tamper", "caught"),
    [
        (friction_pushes, {"friction_sign", "force_balance", "equilibrium"}),
        (half_the_locking_stress, {"equilibrium"}),
        (pressure_pulls, {"contact_violation", "force_balance", "equilibrium"}),
        (old_bound, {"friction_bound"}),
        (too_much_friction, {"coulomb_cone", "force_balance"}),
        (pressure_moves_aside, {"moment_balance", "equilibrium"}),
    ],
)
def test_a_tampered_solution_is_not_converged_and_the_reason_names_what_failed(
    n: float, tamper: Tamper, caught: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def tampered(state: SolvedState, *more: Any) -> Any:
        tamper(state)
        return certify(state, *more)

    monkeypatch.setattr(problem_solver, "certify", tampered)
    summary = solving.solve(block(penalty__n=n)).summary
    criteria = summary["certificate"]["criteria"]
    failed = {name for name, entry in criteria.items() if not entry["holds"]}
    assert caught <= failed
    assert summary["converged"] is False
    for name in caught:
        assert f"{criteria[name]['value']:.1e}" in summary["reason"]


def half_r_n(eps: Any, inverse_limit: Any, n: Any) -> Any:
    return n * unit_ball_excess(eps, inverse_limit) * eps


def half_penetration(contact: equations.OnGammaC, v: Any) -> Any:
    return 0.5 * positive_part(normal_part(v, contact.normal) - contact.gap)


def wrong_psi(v: Any, delta: Any) -> Any:
    return 100.0 * delta


@pytest.mark.serial
@pytest.mark.parametrize(
    ("law", "wrong"),
    [
        ("locking_stress", half_r_n),
        ("OnGammaC.penetration", half_penetration),
        ("psi", wrong_psi),
    ],
)
@pytest.mark.parametrize("n", [1e2, 1e4])
def test_a_solver_that_solves_with_a_wrong_law_is_caught(
    n: float, law: str, wrong: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"{equations.__name__}.{law}", wrong)
    parameters = block(penalty={"n": n, "epsilon": 1e-3}, solver={"method": "penalty"})
    summary = solving.solve(parameters).summary
    # The stresses of the right laws are not in equilibrium.
    assert not summary["certificate"]["criteria"]["equilibrium"]["holds"]
    assert summary["converged"] is False


@pytest.mark.serial
def test_a_mollifier_that_changes_constants_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = ConvolutionOperator.apply
    monkeypatch.setattr(
        ConvolutionOperator, "apply", lambda self, values: 1.001 * right(self, values)
    )
    summary = solving.solve(block()).summary
    failed = [
        name for name, entry in summary["certificate"]["criteria"].items() if not entry["holds"]
    ]
    assert failed == ["smoothing_constants"] and not summary["converged"]


@pytest.mark.serial
def test_a_bound_that_does_not_hold_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def small(state: SolvedState, w: Any = None) -> float:
        return 1e-4

    monkeypatch.setattr("contact_locking.theory.bounds.dual_norm", small)
    summary = solving.solve(block()).summary
    assert summary["bounds"]["displacement_norm"]["holds"] is False and not summary["converged"]


# Criteria of good solutions -----------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n", [1e2, 1e6, math.inf])
def test_every_criterion_holds_with_a_margin(dim: int, n: float) -> None:
    criteria = certificate(block(dim, 0.1 if dim == 2 else 0.34, penalty__n=n))["criteria"]
    assert {"equilibrium", "moment_balance", "duality_gap", "friction_sign"} <= set(criteria)
    for name, entry in criteria.items():
        assert entry["holds"] is True
        # A step takes the residual of equilibrium down by a factor of 30; where the solver stops,
        # it is anywhere below its limit.
        share = 0.5 if name == "equilibrium" else 0.1
        assert entry["value"] <= share * entry["limit"], name


@pytest.mark.parametrize("dim", [2, 3])
def test_any_number_of_ranks_gives_the_same_certificate(dim: int) -> None:
    parameters = block(dim, 0.1 if dim == 2 else 0.34, certificate__constants=True)
    together, alone = certificate(parameters), certificate(parameters, MPI.COMM_SELF)
    for path in (
        ("errors", "mesh", "energy_norm"),
        ("errors", "mesh", "with_locking"),
        ("errors", "penalty", "energy_norm"),
        ("constants", "c_0"),
        ("constants", "smoothing_norm"),
        ("bounds", "displacement_norm", "bound"),
    ):
        one, other = together, alone
        for key in path:
            one, other = one[key], other[key]
        assert one == pytest.approx(other, rel=1e-5), path


@pytest.mark.serial
def test_a_solve_that_was_stopped_early_keeps_its_own_reason() -> None:
    parameters = block(solver={"method": "penalty", "max_iterations": 1}, certificate__limit=True)
    summary = solving.solve(parameters).summary
    assert not summary["converged"] and "too many Newton steps" in summary["reason"]
    assert summary["bounds"]["displacement_norm"]["bound"] > 0.0
    assert summary["certificate"]["errors"]["penalty"]["reason"] == "the solve did not converge"
    assert not summary["certificate"]["criteria"]["equilibrium"]["holds"]
