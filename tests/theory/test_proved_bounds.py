"""The certificate's proved bounds: above what they bound, attained where known, or left open."""

from __future__ import annotations

import math
from typing import Any

import pytest
import ufl
from problems import block, solved, under_a_plate, with_changes

from contact_locking.fem.compiled import integral

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


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_the_work_of_locking_is_bounded_over_a_foundation_that_lifts_the_body(n: float) -> None:
    wedge = block(penalty__n=n, contact__gap="-0.003*x")
    lifted = solved(wedge).summary["bounds"]["locking_work"]
    assert lifted["holds"] is True
    # The field that lifts the body has a part of the strain that M allows.
    flat = solved(block(penalty__n=n)).summary["bounds"]["locking_work"]
    assert flat["value"] < lifted["value"] < lifted["bound"]
    assert lifted["bound"] > 1.2 * flat["bound"]


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
