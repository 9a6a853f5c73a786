"""V27: limits of deviator, volume and directions in homogeneous strains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from problems import column, with_changes
from slow import slow
from verification_table import Rows

from contact_locking.laws.body import lame_from_young
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving

pytestmark = pytest.mark.serial

LAME_LAMBDA, LAME_MU = lame_from_young(1.0, 0.3)
K = LAME_LAMBDA + 2.0 * LAME_MU
PRESSURE = 0.05

# Each limit with c and M such that c e <= M is what it says of the uniaxial strain -e.
Limit = tuple[dict[str, Any], float, float]


def deviator(dim: int) -> Limit:
    """The deviator of the three-dimensional strain, also in plane strain."""
    return {"norm": "deviator", "at_most": 0.015}, math.sqrt(2.0 / 3.0), 0.015


def volume(dim: int) -> Limit:
    entry = {"norm": "volume", "at_least": -0.012, "at_most": math.inf}
    return entry, 1.0 / math.sqrt(dim), 0.012 / math.sqrt(dim)


def upright(dim: int) -> Limit:
    along = [0.0] * (dim - 1) + [-3.0]
    return {"norm": "direction", "along": along, "at_least": "-0.01 + 0*x"}, 1.0, 0.01


def weighted(dim: int) -> Limit:
    diagonal = [6.0] * (dim * (dim + 1) // 2)
    diagonal[dim - 1] = 3.0
    matrix = np.diag(diagonal).tolist()
    return {"norm": "weighted", "matrix": matrix, "at_most": 0.06}, 0.5, 0.01


def only_tension(dim: int) -> Limit:
    return {"norm": "volume", "at_most": 1e-4}, 1.0, math.inf


def strain_under(pressure: float, n: float, limits: list[tuple[float, float]]) -> float:
    """e from ``p = K e + sum 2 n c [c e - M]^+``; for n = inf at most the least M/c."""
    if math.isinf(n):
        return min([pressure / K, *(limit / c for c, limit in limits)])
    active = [(c, limit) for c, limit in limits if c * pressure / K > limit]
    push = pressure + sum(2.0 * n * c * limit for c, limit in active)
    return push / (K + sum(2.0 * n * c**2 for c, _ in active))


def require_solved(solution: StudySolution) -> Mapping[str, Any]:
    summary = solution.summary
    assert summary["converged"], summary["reason"]
    return summary


@pytest.mark.parametrize(
    ("limit", "dim", "n", "method"),
    [
        *((make, 2, math.inf, "auto") for make in (deviator, volume, upright, weighted)),
        (deviator, 2, 1e3, "interior_point"),
        (volume, 2, 1e3, "interior_point"),
        *(slow(make, 3, n, "auto") for make in (deviator, volume) for n in (1e3, math.inf)),
        (only_tension, 2, math.inf, "auto"),
    ],
)  # fmt: skip
def test_v27_a_column_under_pressure_has_the_strain_that_its_limit_leaves(
    limit: Any, dim: int, n: float, method: str, found: Rows
) -> None:
    entry, c, largest = limit(dim)
    material = {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking": [entry]}
    solution = solving.solve(
        column(dim, PRESSURE, material=material, penalty__n=n, solver__method=method)
    )
    summary = require_solved(solution)
    exact = strain_under(PRESSURE, n, [(c, largest)])
    where = f"column, {dim}D, limit of {limit.__name__}, n = {n:g}, {method}"
    found.add("V27", where, "strain", summary["strain_norm_max"], exact, rel=1e-6)
    is_free = math.isinf(largest)
    assert summary["locked_fraction"] == pytest.approx(0.0 if is_free else 1.0)
    # The foundation carries the pressure, of which K e is elastic and the rest is locking stress.
    stress = solution.locking_stress.x.array.reshape(-1, dim, dim)[:, -1, -1]
    carried = 0.0 if is_free else PRESSURE - K * exact
    found.add("V27", where, "locking stress", -stress.mean(), carried)
    # In 3D the multiplier of the inequality is not unique, and rounding chooses.
    assert -stress == pytest.approx(carried, abs=1e-5 * PRESSURE)
    assert summary["contact_force"][-1] == pytest.approx(PRESSURE, rel=1e-6)
    # The work of the locking stress at the limit is M |y| for each volume, here of 2.
    work = 2.0 * (PRESSURE - K * exact) * (0.0 if is_free else largest / c)
    assert summary["bounds"]["locking_work"]["value"] == pytest.approx(work, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("n", [1e3, math.inf])
def test_v27_two_families_of_fibres_share_the_load(n: float, found: Rows) -> None:
    """Under the angles +-t to the horizontal a uniaxial strain e stretches them by e sin^2 t."""
    angle, slack = 1.0, 0.01
    fibres = [
        {"norm": "direction", "along": [math.cos(angle), side * math.sin(angle)], "at_most": slack}
        for side in (1.0, -1.0)
    ]
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [1.0, 2.0], "h": 0.5},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking": fibres},
        "loads": {
            "tractions": [{"on": "top", "value": [0.0, PRESSURE]}],
            "displacements": [
                {"on": ["left", "right"], "value": [0.0, None]},
                {"on": "bottom", "value": [None, 0.0]},
            ],
        },
        "contact": {"on": []},
        "penalty": {"n": n},
    }
    summary = require_solved(solving.solve(with_changes(data)))
    c = math.sin(angle) ** 2
    exact = strain_under(PRESSURE, n, [(c, slack)] * 2)
    assert exact < 0.9 * PRESSURE / K
    where = f"two families of fibres in tension, n = {n:g}"
    found.add("V27", where, "strain", summary["strain_norm_max"], exact, rel=1e-6)
    # The other way the fibres are slack.
    data["loads"]["tractions"][0]["value"] = [0.0, -PRESSURE]
    summary = require_solved(solving.solve(with_changes(data)))
    assert summary["strain_norm_max"] == pytest.approx(PRESSURE / K, rel=1e-8)


@pytest.mark.parametrize(("dim", "n"), [(2, 1e3), (2, math.inf), (3, math.inf)])
def test_v27_shear_stops_at_the_limit_of_the_deviator(dim: int, n: float, found: Rows) -> None:
    """``u = (g y, 0)``: ``|dev eps| = |eps| = g/sqrt(2)``, and the volume does not change."""
    traction, limit = 0.03, 0.02
    held = [None] * (dim - 1) + [0.0]
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": 0.5},
        "material": {
            "elasticity": {"young": 1.0, "poisson": 0.3},
            "locking": [
                {"norm": "deviator", "at_most": limit},
                {"norm": "volume", "at_most": 1e-5, "at_least": -1e-5},
            ],
        },
        "loads": {
            "tractions": [{"on": "top", "value": [traction] + [0.0] * (dim - 1)}],
            "displacements": [
                {"on": "bottom", "value": [0.0] * dim},
                {"on": ["left", "right", "top"], "value": held},
            ],
        },
        "contact": {"on": []},
        "penalty": {"n": n},
    }
    summary = require_solved(solving.solve(with_changes(data)))
    # t = mu g + 2 n [g/sqrt(2) - M]^+/sqrt(2)
    angle = math.sqrt(2.0) * limit
    if math.isfinite(n):
        angle = (traction + math.sqrt(2.0) * n * limit) / (LAME_MU + n)
    assert angle < 0.8 * traction / LAME_MU
    where = f"simple shear, {dim}D, n = {n:g}"
    exact = angle / math.sqrt(2.0)
    found.add("V27", where, "strain", summary["strain_norm_max"], exact, rel=1e-6)
    used = {entry["name"]: entry["locked_fraction"] for entry in summary["strain_sets"]}
    assert used == {"deviator": 1.0, "volume at_most": 0.0, "volume at_least": 0.0}
