"""The certificate's proved bounds: above what they bound, attained where known, or left open."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import ufl
from certified import certificate
from mpi4py import MPI
from problems import block, column, solved, under_a_plate, with_changes

from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import FrictionBound, FrictionLaw
from contact_locking.fem.compiled import integral
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled
from contact_locking.theory.constants import SAMPLED

pytestmark = pytest.mark.serial


def stretched(limit: float, n: float, **more: Any) -> dict[str, Any]:
    """A bar with A = alpha I, alpha = 2, under a uniform stress f = 0.04; its summary."""
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
            **more,
        }
    )
    return dict(solved(bar).summary)


def test_the_bound_of_the_locking_work_is_attained_for_n_infinite() -> None:
    # alpha M = f/2, so |Z| = f/2 and M |Z| = f^2/(4 alpha).
    bounds = stretched(0.01, math.inf)["bounds"]
    assert set(bounds) == {"displacement_norm", "locking_work"}
    assert bounds["locking_work"]["value"] == pytest.approx(0.04**2 / 8.0, rel=1e-6)
    assert bounds["locking_work"]["bound"] == pytest.approx(0.04**2 / 8.0, rel=1e-9)
    assert bounds["locking_work"]["holds"] is True


def test_the_bound_of_the_locking_penalty_is_attained_by_a_limit_near_zero() -> None:
    # alpha e + 2n (e - M) = f with 2n = alpha and M << e: 2n e^2 = f^2/(4 alpha).
    penalty = stretched(1e-6, 1.0)["bounds"]["locking_penalty"]
    assert penalty["value"] == pytest.approx(0.04**2 / 8.0, rel=1e-3)
    assert penalty["value"] <= penalty["bound"] <= 0.04**2 / 8.0 * (1.0 + 1e-9)


def _distance_of(summary: dict[str, Any]) -> float:
    """``a(e, e)`` of the measured change by the penalty."""
    return float(summary["certificate"]["errors"]["penalty_measured"]["energy_norm"] ** 2)


@pytest.mark.parametrize(("n", "share"), [(0.2, 0.56), (1.0, 1.0), (10.0, 0.33)])
def test_the_estimate_of_the_penalty_by_the_locking_stress_is_attained_for_2n_of_alpha(
    n: float, share: float
) -> None:
    """``a(e, e) <= |Z|^2/8n`` with Z = f - alpha M, and ``e = Z/(alpha + 2n)`` in the bar."""
    bound = 0.02**2 / (8.0 * n)
    found = _distance_of(stretched(0.01, n, certificate={"limit": True}))
    assert found <= bound * (1.0 + 1e-6)
    assert found == pytest.approx(share * bound, rel=0.02)


@pytest.mark.parametrize("n", [10.0, 1e2, 1e3, 1e4])
def test_without_friction_the_multipliers_bound_what_the_penalty_changes(n: float) -> None:
    """``a(e, e) <= |Z|^2/8n + eps |p|^2/4`` with the multipliers of n = inf on the same mesh."""
    exact = solved(block(penalty__n=math.inf, friction__coefficient=0.0))
    stress, (contact,) = exact.locking_stress, exact.contacts
    dx = ufl.Measure("dx", exact.domain.mesh)
    bound = integral(exact.domain, ufl.inner(stress, stress) * dx) / (8.0 * n)
    bound += float(contact.surface.integral(contact.pressure**2)) / (4.0 * n)
    penalised = block(penalty__n=n, friction__coefficient=0.0, certificate__limit=True)
    assert 0.001 * bound < _distance_of(dict(solved(penalised).summary)) <= bound


@pytest.mark.parametrize("n", [1e2, 1e5, math.inf])
@pytest.mark.parametrize("gap", [0.0, 0.004])
def test_the_work_of_locking_is_bounded_for_any_n(n: float, gap: float) -> None:
    work = solved(block(penalty__n=n, contact__gap=gap)).summary["bounds"]["locking_work"]
    assert work["holds"] is True
    assert 0.01 * work["bound"] < work["value"] < work["bound"]


@pytest.mark.parametrize("n", [1e2, 1e4, math.inf])
def test_prescribed_displacements_that_an_elastic_field_follows_have_bounds(n: float) -> None:
    bounds = solved(under_a_plate(0.004, penalty__n=n)).summary["bounds"]
    for entry in bounds.values():
        assert entry["holds"] is True
        assert entry["value"] <= entry["bound"]
    assert bounds["displacement_norm"]["value"] > 0.2 * bounds["displacement_norm"]["bound"]


def test_prescribed_displacements_beyond_an_elastic_field_leave_the_bounds_open() -> None:
    for entry in solved(under_a_plate(0.019)).summary["bounds"].values():
        assert entry["bound"] is None and entry["holds"] is None
        assert "exceeds the locking limit" in entry["reason"]


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
        ({"penalty__n": math.inf}, "not known", "can lock next to Gamma_C"),
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


def test_a_bound_of_the_users_own_has_no_verdict() -> None:
    class Capped(FrictionBound):
        def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
            return np.minimum(super().evaluate(pressure, slip), 0.004)

    found = constants_of(slip_weakening, Capped)["uniqueness"]
    assert found["verdict"] == "not known" and "friction bound" in found["why"]
