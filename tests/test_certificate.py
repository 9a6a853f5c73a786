"""The certificate: criteria that catch planted defects, proved bounds, constants, estimates."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block, column, with_changes

from contact_locking import forms, problem, results
from contact_locking.certificate import certify, elliptic
from contact_locking.certificate.state import SolvedState
from contact_locking.convex import positive_part, unit_ball_excess
from contact_locking.parameters import Parameters
from contact_locking.smoothing import Convolution
from contact_locking.solution import Solution
from contact_locking.solver.linear import ITERATIVE

Tamper = Callable[[SolvedState], None]


def solved(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Solution:
    solution = problem.solve(parameters, comm)
    assert solution.converged, solution.summary["reason"]
    return solution


def certificate(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> dict[str, Any]:
    return dict(solved(parameters, comm).summary["certificate"])


# Planted defects ----------------------------------------------------------------------------------


def friction_pushes(state: SolvedState) -> None:
    assert state.contact is not None
    state.contact.traction = 0.0 - state.contact.traction


def half_the_locking_stress(state: SolvedState) -> None:
    state.body.locking_stress.x.array[:] *= 0.5


def pressure_pulls(state: SolvedState) -> None:
    assert state.contact is not None
    state.contact.pressure = 0.0 - state.contact.pressure


def old_bound(state: SolvedState) -> None:
    assert state.contact is not None
    state.contact.bound = 1.01 * state.contact.bound


def too_much_friction(state: SolvedState) -> None:
    assert state.contact is not None
    state.contact.traction = 20.0 * state.contact.traction


def pressure_moves_aside(state: SolvedState) -> None:
    """The resultant stays where it is in size, not in place."""
    assert state.contact is not None
    weights = state.contact.surface.weights
    total = state.sum(weights * state.contact.pressure)
    state.contact.pressure = np.full_like(weights, total / state.sum(weights))


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
    def tampered(state: SolvedState) -> Any:
        tamper(state)
        return certify(state)

    monkeypatch.setattr(problem, "certify", tampered)
    summary = problem.solve(block(penalty__n=n)).summary
    criteria = summary["certificate"]["criteria"]
    failed = {name for name, entry in criteria.items() if not entry["holds"]}
    assert caught <= failed
    assert summary["converged"] is False
    for name in caught:
        assert f"{criteria[name]['value']:.1e}" in summary["reason"]


def half_r_n(eps: Any, inverse_limit: Any, n: Any) -> Any:
    return n * unit_ball_excess(eps, inverse_limit) * eps


def half_pressure(u_normal: Any, gap: Any, epsilon: Any) -> Any:
    return positive_part(u_normal - gap) / (2.0 * epsilon)


def wrong_friction(u_tangential: Any, bound: Any, epsilon: Any) -> Any:
    return 0.01 * bound * u_tangential / epsilon


@pytest.mark.parametrize(
    ("law", "wrong", "caught"),
    [
        ("locking_stress", half_r_n, "locking_violation"),
        ("contact_pressure", half_pressure, "contact_violation"),
        ("friction_traction", wrong_friction, "friction_complementarity"),
    ],
)
@pytest.mark.parametrize("n", [1e2, 1e4])
def test_a_solver_that_solves_with_a_wrong_law_is_caught(
    n: float, law: str, wrong: Any, caught: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in (forms, results):
        if hasattr(module, law):
            monkeypatch.setattr(module, law, wrong)
    parameters = block(penalty={"n": n, "epsilon": 1e-3}, solver={"method": "newton"})
    summary = problem.solve(parameters).summary
    criteria = summary["certificate"]["criteria"]
    # It is in equilibrium with itself ...
    assert criteria["equilibrium"]["holds"] and criteria["force_balance"]["holds"]
    # ... and yet wrong.
    assert not criteria[caught]["holds"]
    assert summary["converged"] is False


def test_a_mollifier_that_changes_constants_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    right = Convolution.apply
    monkeypatch.setattr(Convolution, "apply", lambda self, values: 1.001 * right(self, values))
    summary = problem.solve(block()).summary
    failed = [
        name for name, entry in summary["certificate"]["criteria"].items() if not entry["holds"]
    ]
    assert failed == ["smoothing_constants"] and not summary["converged"]
    assert "change of constants by R is 1.0e-03" in summary["reason"]


def test_a_bound_that_does_not_hold_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def small(state: SolvedState, w: Any = None) -> float:
        return 1e-4

    monkeypatch.setattr("contact_locking.certificate.bounds.dual_norm", small)
    summary = problem.solve(block()).summary
    assert summary["bounds"]["displacement_norm"]["holds"] is False
    assert "proved bound of displacement norm does not hold" in summary["reason"]


# Criteria of good solutions -----------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n", [1e2, 1e6, math.inf])
def test_every_criterion_holds_with_a_margin(dim: int, n: float) -> None:
    criteria = certificate(block(dim, 0.1 if dim == 2 else 0.34, penalty__n=n))["criteria"]
    assert {"equilibrium", "moment_balance", "duality_gap", "friction_sign"} <= set(criteria)
    for name, entry in criteria.items():
        assert entry["holds"] is True
        assert entry["value"] <= 0.1 * entry["limit"], name


def test_resultants_of_loads_contact_and_reactions_add_up() -> None:
    resultants = certificate(block())["resultants"]
    assert resultants["loads"] == pytest.approx([0.03, -0.05])
    assert np.sum(list(resultants.values()), axis=0) == pytest.approx([0.0, 0.0], abs=1e-9)


def test_a_body_without_contact_has_no_criteria_of_contact() -> None:
    found = certificate(block(contact={"on": []}))
    assert not any("contact" in name or "friction" in name for name in found["criteria"])
    assert found["constants"]["uniqueness"]["verdict"] == "covered by theory"


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


def test_a_solve_that_was_stopped_early_keeps_its_own_reason() -> None:
    parameters = block(solver={"method": "newton", "max_iterations": 1}, certificate__limit=True)
    summary = problem.solve(parameters).summary
    assert not summary["converged"] and "too many Newton steps" in summary["reason"]
    assert summary["bounds"]["displacement_norm"]["bound"] > 0.0
    assert summary["certificate"]["errors"]["penalty"]["reason"] == "the solve did not converge"
    assert not summary["certificate"]["criteria"]["equilibrium"]["holds"]


# Proved bounds ------------------------------------------------------------------------------------


def test_a_column_held_by_contact_alone_has_bounds_that_are_nearly_attained() -> None:
    parameters = column(pressure=0.01, penalty={"n": 1e3, "epsilon": 1e-2})
    bounds = solved(parameters).summary["bounds"]
    displacement = bounds["displacement_norm"]
    # The springs carry the same uniform stress, so only the gap and the penetration are lost.
    assert displacement["holds"] and bounds["contact_penalty"]["holds"]
    at_once = column(pressure=0.01, contact__gap=0.0, penalty={"n": 1e3, "epsilon": 1e-12})
    displacement = solved(at_once).summary["bounds"]["displacement_norm"]
    # a(u, u) = k |eps|^2, and alpha is less than k.
    stiffest, alpha = 1.3461538461538463, 0.7692307692307692
    assert displacement["bound"] / displacement["value"] == pytest.approx(
        math.sqrt(stiffest / alpha), rel=1e-6
    )


def test_a_load_that_lifts_a_part_of_a_loose_body_leaves_the_bounds_open() -> None:
    tilting = column(
        loads__tractions=[{"on": "top", "value": [0.0, "-0.02 + 50*(x - 0.5)"]}],
        contact={"on": "bottom"},
        material__locking_limit=math.inf,
    )
    bound = solved(tilting).summary["bounds"]["displacement_norm"]
    assert bound["bound"] is None and "not carried by a pressure" in bound["reason"]


def moved(down: float, **changes: Any) -> Parameters:
    """A block between its foundation and a plate that is glued to its top."""
    plate = {"displacements": [{"on": "top", "value": [0.0, -down]}]}
    return block(loads=plate, **changes)


@pytest.mark.parametrize("n", [1e2, 1e4, math.inf])
def test_prescribed_displacements_that_an_elastic_field_follows_have_bounds(n: float) -> None:
    bounds = solved(moved(0.004, penalty__n=n)).summary["bounds"]
    for entry in bounds.values():
        assert entry["holds"] is True
        assert entry["value"] <= entry["bound"]
    assert bounds["displacement_norm"]["value"] > 0.2 * bounds["displacement_norm"]["bound"]


def test_a_negative_gap_is_lifted_over() -> None:
    bounds = solved(moved(0.0, contact__gap=-0.003)).summary["bounds"]
    assert all(entry["holds"] is True for entry in bounds.values())


def test_prescribed_displacements_beyond_an_elastic_field_leave_the_bounds_open() -> None:
    for entry in solved(moved(0.019)).summary["bounds"].values():
        assert entry["bound"] is None and entry["holds"] is None
        assert "exceeds the locking limit" in entry["reason"]


def test_dual_norm_by_cg_with_rigid_motions_is_that_of_the_direct_solver(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def bound() -> float:
        return float(solved(block(3, 0.25)).summary["bounds"]["displacement_norm"]["bound"])

    direct = bound()
    monkeypatch.setattr(elliptic, "default_options", lambda *_: dict(ITERATIVE))
    assert bound() == pytest.approx(direct, rel=1e-7)


# Constants ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
def test_trace_constant_of_a_column_under_its_fixed_top_is_the_root_of_its_height(dim: int) -> None:
    rollers = [{"on": ["left", "right"], "value": [0.0] + [None] * (dim - 1)}]
    if dim == 3:
        rollers.append({"on": ["front", "back"], "value": [None, 0.0, None]})
    top = {"on": "top", "value": [0.0] * (dim - 1) + [-0.01]}
    found = certificate(
        column(
            dim,
            loads={"displacements": [*rollers, top]},
            contact__gap=0.0,
            certificate__constants=True,
        )
    )["constants"]
    # v = (0, 2 - y): |v|^2 on the bottom is 4, |eps(v)|^2 is 2.
    assert found["c_0"] == pytest.approx(math.sqrt(2.0), rel=1e-6)
    assert found["alpha"] == pytest.approx(1.0 / 1.3)


def test_constants_of_a_slip_dependent_coefficient_are_sampled() -> None:
    found = certificate(block(friction__coefficient="0.4 - 0.3*(1 - exp(-s/0.005))"))["constants"]
    assert found["friction_constants"] == "sampled"
    assert found["friction_coefficient"] == pytest.approx(0.4)
    assert found["friction_lipschitz"] == pytest.approx(60.0, rel=1e-3)
    assert found["c_0"] is None and "certificate.constants" in found["c_0_reason"]


@pytest.mark.parametrize(
    ("changes", "verdict", "why"),
    [
        ({"friction__coefficient": 0.0}, "covered by theory", "no friction"),
        ({"friction__coefficient": 0.05, "penalty__epsilon": 0.1}, "covered by theory", "is below"),
        ({"friction__coefficient": 0.3}, "not known", "is not below"),
        ({"penalty__n": math.inf}, "not known", "not explicit"),
    ],
)
def test_uniqueness_is_covered_by_theory_or_not_known(
    changes: dict[str, Any], verdict: str, why: str
) -> None:
    found = certificate(block(certificate__constants=True, **changes))["constants"]["uniqueness"]
    assert found["verdict"] == verdict and why in found["why"]


def test_the_observed_contraction_factor_stands_beside_the_verdict() -> None:
    found = certificate(block(solver={"method": "newton"}))["constants"]["uniqueness"]
    assert 0.0 < found["contraction"] < 1.0


# Error estimates ----------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{"friction__coefficient": 0.0}, {"contact__gap": 0.002}, {}])
def test_the_bound_on_the_distance_to_the_inequality_holds(changes: dict[str, Any]) -> None:
    before = math.inf
    for n in (1e2, 1e4, 1e6):
        errors = certificate(block(penalty__n=n, certificate__limit=True, **changes))["errors"]
        bound, measured = errors["penalty"], errors["penalty_measured"]
        for key in ("energy_norm", "relative", "displacement_norm"):
            assert 0.0 < measured[key] <= bound[key]
        # eta^2 is of the order 1/n.
        assert bound["energy_norm"] < 0.3 * before
        before = bound["energy_norm"]


def test_the_solution_of_the_inequality_is_at_no_distance_from_itself() -> None:
    errors = certificate(block(penalty__n=math.inf, certificate__limit=True))["errors"]
    assert errors["penalty"]["energy_norm"] == 0.0
    assert errors["penalty_measured"]["relative"] <= 1e-7


def test_the_distance_of_a_column_is_that_of_its_exact_solutions() -> None:
    # Without locking both columns have the same strain, and the penalised one has sunk further.
    found = certificate(column(pressure=0.01, certificate__limit=True))["errors"]
    assert found["penalty_measured"]["relative"] <= 1e-7
    locked = certificate(column(pressure=0.05, certificate__limit=True))["errors"]
    k = 1.3461538461538463
    excess = (0.05 - k * 0.02) / (k + 2e3)
    exact = math.sqrt(k * 2.0) * excess
    assert locked["penalty_measured"]["energy_norm"] == pytest.approx(exact, rel=1e-5)
    assert locked["penalty"]["energy_norm"] >= exact


def test_where_no_admissible_field_is_found_the_bound_is_left_open_with_the_reason() -> None:
    penalty = certificate(moved(0.019))["errors"]["penalty"]
    assert penalty["energy_norm"] is None and "locking limit" in penalty["reason"]


@pytest.mark.parametrize("dim", [2, 3])
def test_the_indicator_vanishes_for_a_solution_that_is_exact(dim: int) -> None:
    solution = solved(column(dim))
    assert np.abs(solution.error_indicator.x.array).max() <= 1e-7
    assert solution.summary["certificate"]["errors"]["mesh"]["with_locking"] <= 1e-7


def test_the_indicator_does_not_see_a_jump_between_regions_as_an_error() -> None:
    # An inclusion of another stiffness under a uniform strain, which displacements enforce.
    strained = with_changes(
        {
            "mesh": {"builder": "inclusion", "h": 0.1},
            "material": {"regions": {"inclusion": {"elasticity": {"young": 9.0, "poisson": 0.3}}}},
            "loads": {
                "displacements": [
                    {"on": ["left", "right", "bottom", "top"], "value": ["0.01*x", "-0.01*y"]}
                ],
            },
            "contact": {"on": []},
        }
    )
    uniform = with_changes(
        {**strained.model_dump(include={"mesh", "loads", "contact"}), "material": {}}
    )
    exact = certificate(uniform)["errors"]["mesh"]["energy_norm"]
    assert exact <= 1e-9
    found = certificate(strained)["errors"]["mesh"]
    assert 0.0 < found["relative"] < 0.2
