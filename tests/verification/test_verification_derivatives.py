"""V41 and V43: derivatives, and a fit, beside closed forms: Hertz's ball and Lame's ring."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from problems import solved, with_changes
from test_verification_curved import LAME, NU, PRESS
from test_verification_hertz import DEPTH, POISSON, RADIUS, YOUNG, section
from verification_table import Rows

from contact_locking.inverse import fitting

E, NU_KEY = "material.elasticity.young", "material.elasticity.poisson"


def derivatives(data: dict[str, Any], force: str, keys: list[str]) -> dict[str, dict[str, float]]:
    """Derivative and elasticity of a force by each key."""
    asked = {"sensitivities": {"of": [force], "to": keys}, "penalty": {"n": float("inf")}}
    solution = solved(with_changes(data | asked))
    return dict(solution.summary["sensitivities"][force])


@pytest.mark.serial
def test_v41_the_force_on_a_ball_changes_as_hertz_says(tmp_path: Path, found: Rows) -> None:
    """``F = 4/3 E/(1 - nu^2) R^1/2 d^3/2``."""
    file = tmp_path / "half_section.msh"
    section(file, 8.0, 1.0, 0.005, dim=2)
    data = {
        "parameters": {"radius": RADIUS, "depth": DEPTH},
        "mesh": {"file": str(file), "axisymmetric": True},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {"displacements": [{"on": "top", "value": [0, 0]}]},
        "contact": {"on": "bottom", "gap": "x*x/(2*radius) - depth"},
    }
    closed = {
        "parameters.radius": 0.5,
        "parameters.depth": 1.5,
        E: 1.0,
        NU_KEY: 2.0 * POISSON**2 / (1.0 - POISSON**2),
    }
    computed = derivatives(data, "contact_force.1", list(closed))
    for key, expected in closed.items():
        elasticity = computed[key]["elasticity"]
        where = f"d ln F/d ln {key.rpartition('.')[2]}"
        found.add("V41", "indented cylinder", where, elasticity, expected, rel=0.05)
    # The discrete force is proportional to E as well.
    assert computed[E]["elasticity"] == pytest.approx(1.0, abs=1e-6)


def ring() -> dict[str, Any]:
    """A quarter of a ring in a rigid one that presses it."""
    return {
        "parameters": {"press": PRESS},
        "mesh": {"builder": "annulus", "h": 0.2, "quarter": True},
        "material": {"elasticity": {"young": 1.0, "poisson": NU}},
        "loads": {
            "displacements": [
                {"on": "bottom", "value": [None, 0]},
                {"on": "left", "value": [0, None]},
            ]
        },
        "contact": {
            "on": "outer",
            "foundation": {"expression": "2.0 - press - sqrt(x**2 + y**2)"},
        },
        "discretisation": {"degree": 2},
    }


@pytest.mark.serial
def test_v42_a_fit_finds_the_modulus_of_lames_ring(tmp_path: Path, found: Rows) -> None:
    """The curve is the closed form for E = 1; both quarters of the force are twice the pressure."""
    curve = tmp_path / "curve.csv"
    rows = [f"{share * PRESS},{-2.0 * share * LAME}" for share in (0.5, 1.0)]
    curve.write_text("\n".join(["parameters.press,force", *rows]) + "\n")
    given = {
        "data": str(curve),
        "quantities": {"force": "contact_force.0"},
        "parameters": {E: {"start": 1.5, "bounds": [0.1, 10], "scale": "log"}},
    }
    data = ring() | {"fit": given, "penalty": {"n": float("inf")}}
    content, _ = fitting.fit(with_changes(data), tmp_path / "results")
    value = content["parameters"][E]["value"]
    found.add("V43", "ring in a rigid ring, fitted", "E", value, 1.0, rel=0.01)
    # The ends of the interval take two.
    assert content["evaluations"] <= 6 + 2


def test_v41_the_pressure_of_a_ring_changes_as_lame_says(found: Rows) -> None:
    data = ring()
    # p = press/(2 (1 - nu^2) (5/3 - nu/(1 - nu))), and the component of the force is -2 p.
    slope = 2.0 * NU / (1.0 - NU**2) + 1.0 / ((1.0 - NU) ** 2 * (5.0 / 3.0 - NU / (1.0 - NU)))
    closed = {"parameters.press": LAME / PRESS, E: LAME, NU_KEY: LAME * slope}
    computed = derivatives(data, "contact_force.0", list(closed))
    for key, expected in closed.items():
        derivative = -0.5 * computed[key]["derivative"]
        where = f"dp/d {key.rpartition('.')[2]}"
        found.add("V41", "ring in a rigid ring", where, derivative, expected, rel=0.01)
    # The discrete force is proportional to E as well.
    assert computed[E]["elasticity"] == pytest.approx(1.0, abs=1e-6)
