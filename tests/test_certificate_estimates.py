"""The certificate's proved bounds, constants and error estimates, against what is known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from certified import certificate, solved
from mpi4py import MPI
from problems import block, column, with_changes

from contact_locking.arrays import FloatArray
from contact_locking.certificate import elliptic, indicator
from contact_locking.certificate.constants import SAMPLED
from contact_locking.laws.friction_law import FrictionLaw
from contact_locking.parameters import Parameters
from contact_locking.problem.assembly import assemble
from contact_locking.problem.contact import FrictionBound
from contact_locking.solver.linear.ksp import iterative_options
from contact_locking.solving import solve_assembled

# Proved bounds ------------------------------------------------------------------------------------


def stretched(limit: float, n: float) -> dict[str, Any]:
    """A bar with A = alpha I, alpha = 2, under a uniform stress f = 0.04; its bounds."""
    bar = with_changes(
        {
            "mesh": {"builder": "block", "h": 0.5},
            "material": {"elasticity": {"lambda": 0.0, "mu": 1.0}, "locking_limit": limit},
            "loads": {
                "displacements": [{"on": "left", "value": [0.0, 0.0]}],
                "tractions": [{"on": "right", "value": [0.04, 0.0]}],
            },
            "contact": {"on": []},
            "penalty": {"n": n},
        }
    )
    return dict(solved(bar).summary["bounds"])


def test_the_bound_of_the_locking_work_is_attained_for_n_infinite() -> None:
    # alpha M = f/2, so |Z| = f/2 and M |Z| = f^2/(4 alpha).
    bounds = stretched(0.01, math.inf)
    assert set(bounds) == {"displacement_norm", "locking_work"}
    assert bounds["locking_work"]["value"] == pytest.approx(0.04**2 / 8.0, rel=1e-6)
    assert bounds["locking_work"]["bound"] == pytest.approx(0.04**2 / 8.0, rel=1e-9)
    assert bounds["locking_work"]["holds"] is True


def test_the_bound_of_the_locking_penalty_is_attained_by_a_limit_near_zero() -> None:
    # alpha e + 2n (e - M) = f with 2n = alpha and M << e: 2n e^2 = f^2/(4 alpha).
    penalty = stretched(1e-6, 1.0)["locking_penalty"]
    assert penalty["value"] == pytest.approx(0.04**2 / 8.0, rel=1e-3)
    assert penalty["value"] <= penalty["bound"] <= 0.04**2 / 8.0 * (1.0 + 1e-9)


@pytest.mark.parametrize("n", [1e2, 1e5, math.inf])
@pytest.mark.parametrize("gap", [0.0, 0.004])
def test_the_work_of_locking_is_bounded_for_any_n(n: float, gap: float) -> None:
    work = solved(block(penalty__n=n, contact__gap=gap)).summary["bounds"]["locking_work"]
    assert work["holds"] is True
    assert 0.01 * work["bound"] < work["value"] < work["bound"]


def test_a_column_held_by_contact_alone_has_bounds_that_are_nearly_attained() -> None:
    parameters = column(pressure=0.01, penalty={"n": 1e3, "epsilon": 1e-2})
    bounds = solved(parameters).summary["bounds"]
    # The springs carry the same uniform stress, so only the gap and the penetration are lost.
    assert all(entry["holds"] for entry in bounds.values())
    at_once = column(pressure=0.01, contact__gap=0.0, penalty={"n": 1e3, "epsilon": 1e-12})
    displacement = solved(at_once).summary["bounds"]["displacement_norm"]
    # a(u, u) = k |eps|^2, and alpha is less than k.
    stiffest, alpha = 1.3461538461538463, 0.7692307692307692
    assert displacement["bound"] / displacement["value"] == pytest.approx(
        math.sqrt(stiffest / alpha), rel=1e-6
    )


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_work_of_locking_is_bounded_where_contact_alone_holds_the_body(n: float) -> None:
    pressed = column(pressure=0.05, contact__gap=0.0, penalty={"n": n, "epsilon": 1e-3})
    work = solved(pressed).summary["bounds"]["locking_work"]
    assert work["holds"] is True
    assert 0.1 * work["bound"] < work["value"] <= work["bound"]


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_work_of_locking_is_bounded_over_a_foundation_that_lifts_the_body(n: float) -> None:
    wedge = block(penalty__n=n, contact__gap="-0.003*x")
    lifted = solved(wedge).summary["bounds"]["locking_work"]
    assert lifted["holds"] is True
    # The field that lifts the body has a part of the strain that M allows.
    flat = solved(block(penalty__n=n)).summary["bounds"]["locking_work"]
    assert flat["value"] < lifted["value"] < lifted["bound"]
    assert lifted["bound"] > 1.2 * flat["bound"]


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
    monkeypatch.setattr(elliptic, "default_options", lambda *_: iterative_options())
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
        ({"friction__coefficient": 0.05, "penalty__epsilon": 0.1}, SAMPLED, "is below"),
        ({"friction__coefficient": 0.3}, "not known", "is not below"),
        ({"penalty__n": math.inf}, "not known", "not explicit"),
    ],
)
def test_uniqueness_is_covered_by_theory_by_sampled_constants_or_not_known(
    changes: dict[str, Any], verdict: str, why: str
) -> None:
    found = certificate(block(certificate__constants=True, **changes))["constants"]["uniqueness"]
    assert found["verdict"] == verdict and why in found["why"]


def test_a_coefficient_of_place_alone_has_exact_constants() -> None:
    found = certificate(block(friction__coefficient="0.1 + 0.2*x"))["constants"]
    assert (found["friction_coefficient"], found["friction_lipschitz"]) == (pytest.approx(0.3), 0.0)
    assert found["friction_constants"] == "exact"


def constants_of(law: Any, bound: type[FrictionBound] = FrictionBound) -> dict[str, Any]:
    """The constants of a soft block with another friction law than the study file's."""
    study = block(h=0.2, penalty__epsilon=0.1, certificate__constants=True)
    problem = assemble(study, MPI.COMM_WORLD)
    (contact,) = problem.contacts
    contact.friction = bound(contact.surface, contact.friction.smoothing, law)
    return dict(solve_assembled(problem).summary["certificate"]["constants"])


def slip_weakening(points: FloatArray, slip: FloatArray) -> FloatArray:
    """mu* = 0.02, L_mu = 0.01."""
    return 0.01 + 0.01 * np.exp(-slip)


def test_the_certificate_asks_a_law_of_the_users_own_for_its_constants() -> None:
    plain = constants_of(slip_weakening)
    assert plain["friction_constants"] == "sampled"
    assert plain["friction_coefficient"] == pytest.approx(0.02)
    assert plain["friction_lipschitz"] == pytest.approx(0.01, rel=0.01)
    assert plain["uniqueness"]["verdict"] == SAMPLED and "sampled" in plain["uniqueness"]["why"]
    stated = constants_of(FrictionLaw(slip_weakening, largest=0.02, lipschitz=0.011))
    assert stated["friction_constants"] == "exact"
    assert (stated["friction_coefficient"], stated["friction_lipschitz"]) == (0.02, 0.011)
    assert "mu* and L_mu sampled" not in stated["uniqueness"]["why"]


def test_a_law_that_exceeds_what_it_states_has_no_verdict() -> None:
    found = constants_of(FrictionLaw(slip_weakening, largest=0.02, lipschitz=0.001))["uniqueness"]
    assert found["verdict"] == "not known" and "exceeds" in found["why"]


def test_a_bound_of_the_users_own_has_no_verdict() -> None:
    class Capped(FrictionBound):
        def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
            return np.minimum(super().evaluate(pressure, slip), 0.004)

    found = constants_of(slip_weakening, Capped)["uniqueness"]
    assert found["verdict"] == "not known" and "user's own" in found["why"]


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
    assert solution.error_indicator is not None
    assert np.abs(solution.error_indicator.x.array).max() <= 1e-7
    assert solution.summary["certificate"]["errors"]["mesh"]["with_locking"] <= 1e-7


def test_the_indicator_does_not_take_a_jump_between_regions_for_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stretched = with_changes(
        {
            "mesh": {"builder": "inclusion", "h": 0.05},
            "material": {"regions": {"inclusion": {"elasticity": {"young": 20.0, "poisson": 0.3}}}},
            "loads": {
                "displacements": [
                    {"on": ["left", "right"], "value": ["0.01*x", None]},
                    {"on": "bottom", "value": [None, 0.0]},
                ]
            },
            "contact": {"on": []},
        }
    )
    by_region = certificate(stretched)["errors"]["mesh"]["energy_norm"]
    monkeypatch.setattr(indicator, "_regions", lambda _, count: [np.ones(count, dtype=bool)])
    across = certificate(stretched)["errors"]["mesh"]["energy_norm"]
    # The indicator inside each region falls like h, that across like sqrt(h) in the end.
    assert 0.0 < by_region < 0.85 * across
