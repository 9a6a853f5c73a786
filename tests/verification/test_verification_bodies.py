"""V38, V39, V40, V50: press-fitted rings, two discs, a block on a stiff block, and two balls."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from dolfinx.mesh import Mesh
from problems import solved
from two_bodies import POISSON, fit, lame_pressure, stack, two_discs
from verification_table import Rows

import contact_locking as cl

pytestmark = pytest.mark.serial

pytest.importorskip("gmsh")


def above_and_below(mesh: Mesh, above: float, below: float) -> fem.Function:
    """A function with one value in the cells above y = 0 and another one below."""
    found = fem.Function(fem.functionspace(mesh, ("DG", 0)))
    found.interpolate(lambda x: np.where(x[1] > 0.0, above, below))
    return found


@pytest.mark.parametrize("swapped", [False, True])
def test_v38_press_fitted_rings_have_the_pressure_of_lame(swapped: bool, found: Rows) -> None:
    sides = ("rim", "inner") if swapped else ("inner", "rim")
    contact = {"on": sides[0], "against": sides[1], "gap": -0.01}
    errors = []
    for h in (0.16, 0.08):
        solution = solved(fit(contact=contact, mesh__h=h))
        points, area = solution.contact_points, solution.summary["contact_area"]
        assert area == pytest.approx(math.pi / 2, rel=0.01)
        if points is not None:
            mean = float(points.pressure.mean())
            problem = f"press-fitted rings, {sides[0]} with the conditions, h = {h:g}"
            found.add("V38", problem, "mean pressure", mean, lame_pressure(0.01))
            errors.append(np.abs(points.pressure / lame_pressure(0.01) - 1.0).max())
    if errors:
        assert errors[1] <= 0.6 * errors[0] and errors[1] <= 0.03


@pytest.mark.parametrize(("n", "boxes"), [(math.inf, False), (1e4, False), (math.inf, True)])
def test_v39_two_discs_press_as_hertz_says(n: float, boxes: bool, found: Rows) -> None:
    """Discs in plane strain, or cylinders of height 1 in layers that do not match."""
    radii, youngs, poisson = (1.0, 2.0), (1.0, 3.0), 0.3
    mesh, facets = two_discs(radii, 0.25, 0.02, layers=(1.0, 0.5) if boxes else None)
    space = fem.functionspace(mesh, ("Lagrange", 1, (mesh.geometry.dim,)))
    along, up = np.eye(mesh.geometry.dim)[:2]
    problem = cl.ContactProblem(
        cl.Elasticity(young=above_and_below(mesh, *youngs), poisson=poisson),
        None,
        [
            cl.Support(facets["axis"], along, 0.0),
            cl.Support(facets["bottom"], up, 0.0),
            cl.Support(facets["top"], up, -0.02),
            *[cl.Support(facets["ends"], (0.0, 0.0, 1.0), 0.0)][: int(boxes)],
        ],
        [],
        [cl.Contact(facets["upper"], against=facets["lower"])],
        space=space,
        n=n,
    )
    solution = problem.solve()
    assert solution.converged, solution.summary["reason"]
    force = 2.0 * solution.summary["contact_force"][1]
    stiffness = 1.0 / sum((1.0 - poisson**2) / modulus for modulus in youngs)
    radius = 1.0 / sum(1.0 / r for r in radii)
    half = math.sqrt(4.0 * force * radius / (math.pi * stiffness))
    peak = 2.0 * force / (math.pi * half)
    assert solution.summary["pressure_max"] == pytest.approx(peak, rel=0.03)
    pressure = solution.summary["pressure_max"]
    told = f"two elastic {'cylinders of hexahedra' if boxes else 'discs'}, n = {n:g}"
    found.add("V39", told, "peak pressure", pressure, peak)
    # To half a facet.
    found.add("V39", told, "half-width", solution.summary["contact_area"], half, abs=0.015)
    points = solution.contact_points
    if points is not None:
        exact = peak * np.sqrt(np.maximum(1.0 - (points.x[:, 0] / half) ** 2, 0.0))
        inside = points.x[:, 0] < 0.8 * half
        assert np.abs(points.pressure - exact)[inside].max() <= 0.03 * peak
    problem.close()


def test_v40_a_block_on_a_stiff_block_is_one_on_a_rigid_foundation(found: Rows) -> None:
    held = [{"on": ["upper_left", "upper_right"], "value": [0.0, None]}]
    held.append({"on": "bottom", "value": [0.0, 0.0]})
    load = [{"on": "top", "value": ["0.0", "-0.02*(1 + x)"]}]
    common: dict[str, Any] = {
        "loads": {"displacements": held, "tractions": load},
    }
    rigid = solved(stack(2, 0.2, **common, contact={"on": "upper_bottom"}))
    differences, tangents = [], []
    for young in (1e2, 1e4):
        lower = {"lower": {"elasticity": {"young": young, "poisson": POISSON}}}
        one = solved(stack(2, 0.2, **common, material__regions=lower))
        assert one.summary["pressure_max"] == pytest.approx(rigid.summary["pressure_max"], rel=0.05)
        differences.append(abs(one.summary["displacement_max"] - rigid.summary["displacement_max"]))
        tangents.append(one.summary["iterations"]["tangents"])
    rate = math.log(differences[0] / differences[1]) / math.log(100.0)
    problem = "a block on a stiff block, beside a rigid foundation"
    found.add("V40", problem, "rate of the displacement in 1/E", rate, 1.0)
    # As 1/E of the stiff block.
    assert differences[1] == pytest.approx(0.01 * differences[0], rel=0.05)
    assert max(tangents) <= rigid.summary["iterations"]["tangents"] + 3


def test_v50_two_balls_press_as_hertz_says(found: Rows) -> None:
    """Balls of different stiffness and radius, as half sections about their axis."""
    radii, youngs, poisson, shift = (1.0, 2.0), (1.0, 3.0), 0.3, 0.01
    mesh, facets = two_discs(radii, 0.2, 0.01)
    space = fem.functionspace(mesh, ("Lagrange", 1, (2,)))
    problem = cl.ContactProblem(
        cl.Elasticity(young=above_and_below(mesh, *youngs), poisson=poisson),
        None,
        [
            cl.Support(facets["bottom"], (0.0, 1.0), 0.0),
            cl.Support(facets["top"], (0.0, 1.0), -shift),
        ],
        [],
        [cl.Contact(facets["upper"], against=facets["lower"])],
        space=space,
        axisymmetric=True,
    )
    solution = problem.solve()
    assert solution.converged, solution.summary["reason"]
    force = solution.summary["contact_force"][1]
    stiffness = 1.0 / sum((1.0 - poisson**2) / modulus for modulus in youngs)
    radius = 1.0 / sum(1.0 / r for r in radii)
    half = (0.75 * force * radius / stiffness) ** (1.0 / 3.0)
    peak = 1.5 * force / (math.pi * half**2)
    found_half = math.sqrt(solution.summary["contact_area"] / math.pi)
    points = solution.contact_points
    told = "two elastic balls"
    found.add("V50", told, "radius of the contact", found_half, half, abs=0.01)
    if points is not None:
        exact = peak * np.sqrt(np.maximum(1.0 - (points.x[:, 0] / half) ** 2, 0.0))
        inside = (points.x[:, 0] > 0.1 * half) & (points.x[:, 0] < 0.9 * half)
        error = np.abs(points.pressure - exact)[inside].max() / peak
        found.add("V50", told, "error of the pressure over its peak", error, None, abs=0.03)
    # The approach of half balls, whose flat faces move, less the compression of their rests.
    approach = half**2 / radius
    found.add("V50", told, "approach of the flat faces", shift, approach)
    assert approach == pytest.approx(shift, rel=0.1)
    problem.close()
