"""V25: balls and indented bodies of revolution; Hertz's contact of a sphere and a half space."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from problems import solved, with_changes
from test_verification_hertz import (
    DEPTH,
    FORCE,
    HALF_WIDTH,
    MODULUS,
    PEAK,
    POISSON,
    RADIUS,
    YOUNG,
    section,
)
from verification_table import Rows

from contact_locking.running import solving

pytestmark = pytest.mark.serial


def test_v25_the_force_of_a_ball_at_a_depth_pushes_the_ball_to_that_depth(found: Rows) -> None:
    def pushed(lift: float, **driven: Any) -> Mapping[str, Any]:
        data: dict[str, Any] = {
            "mesh": {"builder": "block", "size": [1.0, 0.8], "h": 0.1, "axisymmetric": True},
            "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.08},
            "loads": {"displacements": [{"on": "bottom", "value": [0, lift]}]},
            "contact": {
                "on": "top",
                "foundation": {"sphere": {"centre": [0, 1.3], "radius": 0.5}, **driven},
            },
        }
        solution = solved(with_changes(data))
        return solution.summary

    depth = 0.04
    force = pushed(depth)["contact_force"][1]
    reached = pushed(0.0, force=[0.0, force])
    travel = reached["contacts"][0]["tool"]["travel"]
    found.add("V25", "ball in a locking layer, by its force", "depth", travel, depth, rel=1e-5)
    assert reached["contact_force"][1] == pytest.approx(force, rel=1e-8)


def test_v25_an_indented_cylinder_is_near_to_hertz_in_a_second(tmp_path: Path, found: Rows) -> None:
    """``a^3 = 3 F R/(4 E*)``: the data of V4, on a block of 80 half-widths."""
    file = tmp_path / "half_section.msh"
    section(file, 8.0, 1.0, 0.005, dim=2)
    data: dict[str, Any] = {
        "mesh": {"file": str(file), "axisymmetric": True},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {"displacements": [{"on": "top", "value": [0, 0]}]},
        "contact": {"on": "bottom", "gap": f"x*x/(2*{RADIUS}) - {DEPTH}"},
        "penalty": {"n": 1e4, "epsilon": 1e-4},
    }
    solution = solving.solve(with_changes(data))
    summary = solution.summary
    assert summary["converged"], summary["reason"]
    assert solution.contact_points is not None
    force = summary["contact_force"][1]
    # The area changes by whole facets; Hertz's pressure is p^2 = p_0^2 (1 - r^2/a^2).
    by_area = math.sqrt(summary["contact_area"] / math.pi)
    radius, pressure = solution.contact_points.x[:, 0], solution.contact_points.pressure
    inside = pressure > 0.3 * pressure.max()
    slope, top = np.polyfit(radius[inside] ** 2, pressure[inside] ** 2, 1)
    half_width = math.sqrt(-top / slope)
    peak = float(solution.contact_points.pressure.max())
    where = "indented cylinder of radius 8, axisymmetric"
    found.add("V25", where, "force", force, FORCE, rel=0.02)
    found.add("V25", where, "half-width", half_width, HALF_WIDTH, rel=0.01)
    found.add("V25", where, "peak pressure", peak, PEAK, rel=0.02)
    found.add(
        "V25", where, "a^3 over 3FR/(4E*)", half_width**3 / (0.75 * force * RADIUS / MODULUS), 1.0
    )
    assert half_width**3 == pytest.approx(0.75 * force * RADIUS / MODULUS, rel=0.02)
    assert by_area == pytest.approx(HALF_WIDTH, rel=0.03)


@pytest.mark.slow
def test_v25_a_locking_ball_in_space_has_the_forces_of_its_half_section(found: Rows) -> None:
    def pressed(mesh: dict[str, Any], held: list[dict[str, Any]]) -> Mapping[str, Any]:
        dim = 2 if "axisymmetric" in mesh else 3
        up = [0.0] * (dim - 1)
        data: dict[str, Any] = {
            "mesh": mesh,
            "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.1},
            "loads": {"displacements": [*held, {"on": "top", "value": [*up, -0.06]}]},
            "contact": {
                "on": "contact",
                "foundation": {"half_space": {"point": [*up, 0.0], "normal": [*up, 1.0]}},
            },
            "friction": {"coefficient": 0.3, "smoothing": {"kernel": "convolution", "radius": 0.1}},
        }
        solution = solved(with_changes(data))
        return solution.summary

    common = {"radius": 1.0, "quarter": True, "contact_width": 0.5}
    planes = [
        {"on": "symmetry_x", "value": [0, None, None]},
        {"on": "symmetry_y", "value": [None, 0, None]},
    ]
    fine = {"h": 0.05, "h_contact": 0.02, **common}
    section = pressed({"builder": "disc", "axisymmetric": True, **fine}, [])
    quarter = pressed({"builder": "ball", "h": 0.1, "h_contact": 0.04, **common}, planes)
    # Over a quarter of the circle the cosines of the radial direction add up to 1, not to 2 pi.
    pairs = {
        "force": (4.0 * quarter["contact_force"][2], section["contact_force"][1]),
        "energy": (4.0 * quarter["elastic_energy"], section["elastic_energy"]),
        "friction": (quarter["friction_force"][0], section["friction_force"][0] / (2.0 * math.pi)),
    }
    for name, (space, flat) in pairs.items():
        found.add("V25", "pressed ball, 3D beside axisymmetric", name, space, flat, rel=0.05)
