"""V25: bodies of revolution with strains in closed form, balls, and Hertz's contact of a sphere."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import test_verification_hertz as hertz
from convergence import fitted_rate
from dolfinx import fem
from mpi4py import MPI
from problems import solved, with_changes
from slow import slow
from verification_table import Rows

from contact_locking.fem.compiled import integral
from contact_locking.laws.body import lame_from_young, squared_norm
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.assembly import assemble, mesh_of

YOUNG, POISSON = 1.0, 0.3
LAME_LAMBDA, LAME_MU = lame_from_young(YOUNG, POISSON)
PRESSURE, LIMIT = 0.05, 0.03


pytestmark = pytest.mark.serial


def cylinder(**changes: Any) -> StudySolution:
    """A cylinder of radius and height 1 that pressure pushes onto a smooth foundation."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [1.0, 1.0], "h": 0.5, "axisymmetric": True},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {"pressures": [{"on": "top", "value": PRESSURE}]},
        "contact": {"on": "bottom"},
    }
    solution = solved(with_changes(data, **changes))
    return solution


def uniaxial(mu: float, lame_lambda: float = LAME_LAMBDA) -> tuple[float, float]:
    """The strains e_z and e_r = e_hoop under the pressure."""
    young = mu * (3.0 * lame_lambda + 2.0 * mu) / (lame_lambda + mu)
    poisson = lame_lambda / (2.0 * (lame_lambda + mu))
    return -PRESSURE / young, poisson * PRESSURE / young


def norm(strains: tuple[float, float]) -> float:
    return math.sqrt(strains[0] ** 2 + 2.0 * strains[1] ** 2)


def ball(n: float) -> tuple[float, float]:
    """``Z = zeta eps`` adds zeta/2 to the shear modulus; ``zeta = 2n (1 - M/|eps|)`` or |eps| = M.

    The root is found by bisection: |eps| falls with zeta.
    """
    low, high = 0.0, 1e3
    for _ in range(200):
        zeta = 0.5 * (low + high)
        size = norm(uniaxial(LAME_MU + 0.5 * zeta))
        wanted = (
            LIMIT if math.isinf(n) else LIMIT / (1.0 - zeta / (2.0 * n)) if zeta < 2.0 * n else 0
        )
        low, high = (zeta, high) if size > wanted > 0.0 else (low, zeta)
    return uniaxial(LAME_MU + 0.5 * zeta)


def volume(n: float) -> tuple[float, float]:
    """``tr eps = -M`` with a pressure q at every point: ``2 mu e_r = q``, ``2 mu e_z = q - p``."""
    q = (PRESSURE - 2.0 * LAME_MU * LIMIT / 3.0) / 3.0
    return (q - PRESSURE) / (2.0 * LAME_MU), q / (2.0 * LAME_MU)


def deviator(n: float) -> tuple[float, float]:
    """``|dev eps| = sqrt(2/3) (e_r - e_z) = M`` with ``tr eps = -p/(3 lambda + 2 mu)``."""
    apart, trace = math.sqrt(1.5) * LIMIT, -PRESSURE / (3.0 * LAME_LAMBDA + 2.0 * LAME_MU)
    return (trace - 2.0 * apart) / 3.0, (trace + apart) / 3.0


@pytest.mark.parametrize("cells", ["simplex", "box"])
@pytest.mark.parametrize(
    ("exact", "locking", "n"),
    [
        (ball, {"norm": "strain", "at_most": LIMIT}, math.inf),
        slow(ball, {"norm": "strain", "at_most": LIMIT}, 3.0),
        slow(volume, {"norm": "volume", "at_least": -LIMIT / 3.0}, math.inf),
        (deviator, {"norm": "deviator", "at_most": LIMIT}, math.inf),
    ],
)
def test_v25_a_cylinder_under_pressure_has_the_radial_and_the_hoop_strain_of_its_limit(
    exact: Callable[[float], tuple[float, float]],
    locking: dict[str, Any],
    n: float,
    cells: str,
    found: Rows,
) -> None:
    given = {"material__locking": [locking], "penalty__n": n}
    solution = cylinder(mesh__cells=cells, **given)
    u, summary = solution.displacement, solution.summary
    x = u.function_space.tabulate_dof_coordinates()
    axial, radial = exact(n)
    nodal = u.x.array.reshape(-1, 2)
    where = f"cylinder under pressure, limit of {exact.__name__}, n = {n:g}"
    where += ", quadrilaterals" if cells == "box" else ""
    outside = x[:, 0] > 1.0 - 1e-9
    width, height = float(nodal[outside, 0].max()), float(nodal[:, 1].min())
    found.add("V25", where, "radial strain", width, radial)
    # The penalty of contact lets the cylinder sink in.
    sunk = 0.0 if math.isinf(n) else PRESSURE / n
    found.add("V25", where, "axial strain", height + sunk, axial)
    assert nodal[:, 0] == pytest.approx(radial * x[:, 0], abs=1e-7)
    assert nodal[:, 1] + sunk == pytest.approx(axial * x[:, 1], abs=1e-7)
    assert summary["strain_norm_max"] == pytest.approx(norm((axial, radial)), rel=1e-6)
    assert summary["locked_fraction"] == pytest.approx(1.0)
    # The force is the pressure times the area of the circle, and the pressure is the same at every
    # node, also on the axis.
    assert summary["contact_force"][1] == pytest.approx(math.pi * PRESSURE, rel=1e-6)
    assert summary["contact_area"] == pytest.approx(math.pi, rel=1e-12)
    pressures = solution.contacts[0].pressure
    assert pressures == pytest.approx(PRESSURE, rel=1e-5)
    # The energy is that of the whole body. A relative duality gap of 1e-8 proves the displacement
    # to 1e-4 in the energy norm and no better; the displacements above agree to 3e-6.
    if n == math.inf:
        elastic = LAME_LAMBDA * (axial + 2.0 * radial) ** 2 / 2.0
        elastic += LAME_MU * norm((axial, radial)) ** 2
        assert summary["elastic_energy"] == pytest.approx(math.pi * elastic, rel=1e-5)


def test_v25_a_cylinder_in_a_rigid_tube_touches_it_all_around(found: Rows) -> None:
    """``e_r = gap``; the axial strain follows from the pressure, the thrust from both."""
    gap = 0.005
    tube = {"on": "right", "foundation": {"half_space": {"point": [1.0 + gap, 0.0],
                                                         "normal": [-1.0, 0.0]}}}  # fmt: skip
    solution = cylinder(contact=[{"on": "bottom"}, tube])
    modulus = LAME_LAMBDA + 2.0 * LAME_MU
    axial = -(PRESSURE + 2.0 * LAME_LAMBDA * gap) / modulus
    thrust = -LAME_LAMBDA * (axial + 2.0 * gap) - 2.0 * LAME_MU * gap
    force = solution.summary["contacts"][1]["contact_force"]
    found.add("V25", "cylinder in a tube", "radial force", -force[0], 2 * math.pi * thrust)
    assert force == pytest.approx([-2.0 * math.pi * thrust, 0.0], rel=1e-6, abs=1e-8)


def ring(h: float, degree: int, cells: str) -> tuple[list[float], StudySolution]:
    """V25: a hollow sphere, of which a quarter of an annulus is the half section.

    The relative errors of the strain and of the displacement.
    """
    inner, outer, pressure = 1.0, 2.0, 0.1
    data: dict[str, Any] = {
        "mesh": {
            "builder": "annulus", "inner_radius": inner, "outer_radius": outer,
            "quarter": True, "h": h, "axisymmetric": True, "cells": cells,
        },
        "discretisation": {"degree": degree},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {
            "pressures": [{"on": "inner", "value": pressure}],
            "displacements": [{"on": "bottom", "value": [None, 0.0]}],
        },
        "contact": {"on": []},
    }  # fmt: skip
    solution = solving.solve(with_changes(data))
    share = pressure * inner**3 / (outer**3 - inner**3)
    # The radial displacement is a R + b/R^2.
    a, b = share * (1 - 2 * POISSON) / YOUNG, share * outer**3 * (1 + POISSON) / (2 * YOUNG)
    mesh, strain = solution.domain.mesh, solution.domain.kinematics.strain
    exact = fem.Function(fem.functionspace(mesh, ("P", 3, (2,))))
    exact.interpolate(lambda x: (a + b / np.linalg.norm(x[:2], axis=0) ** 3) * x[:2])
    u, dx = solution.displacement, solution.domain.dx(quadrature_degree=6)
    pairs = [(strain(u) - strain(exact), strain(exact)), (u - exact, exact)]
    errors = [
        math.sqrt(
            integral(solution.domain, squared_norm(error) * dx)
            / integral(solution.domain, squared_norm(whole) * dx)
        )
        for error, whole in pairs
    ]
    return errors, solution


@pytest.mark.parametrize(
    ("degree", "cells", "rates", "accuracy"),
    [(1, "simplex", (1.0, 2.0), (0.08, 0.01)), (1, "box", (1.0, 2.0), (0.06, 0.01)),
     pytest.param(2, "simplex", (2.0, 2.0), (0.01, 0.004), marks=pytest.mark.slow)],
)  # fmt: skip
def test_v25_a_hollow_sphere_under_pressure_has_lames_displacement(
    degree: int,
    cells: str,
    rates: tuple[float, float],
    accuracy: tuple[float, float],
    found: Rows,
) -> None:
    sizes = (0.4, 0.2, 0.1)
    results = [ring(h, degree, cells) for h in sizes]
    for index, name in enumerate(("strain", "displacement")):
        errors = [result[0][index] for result in results]
        rate = fitted_rate(sizes, errors)
        where = f"hollow sphere under pressure, {'Q' if cells == 'box' else 'P'}{degree}"
        found.add("V25", where, f"rate of the {name}", rate, rates[index])
        found.add(
            "V25", where, f"error of the {name}, h = 0.1", errors[-1], None, abs=accuracy[index]
        )
        assert rate > rates[index] - 0.15
    certificate = results[-1][1].summary["certificate"]
    assert certificate["criteria"]["force_balance"]["holds"]
    # Radial forces balance by symmetry, and there are no moments.
    assert "moment_balance" not in certificate["criteria"]


def test_v25_a_tube_under_inner_pressure_has_lames_displacement(found: Rows) -> None:
    """``u_r = p (1 + nu)/E r_1^2/(r_2^2 - r_1^2) ((1 - 2 nu) r + r_2^2/r)`` for u_z = 0."""
    inner, outer, pressure = 1.0, 2.0, 0.1
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [outer - inner, 0.25], "h": 0.0625, "structured": True,
                 "axisymmetric": True},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {
            "pressures": [{"on": "left", "value": pressure}],
            "displacements": [{"on": ["bottom", "top"], "value": [None, 0.0]}],
        },
        "contact": {"on": []},
    }  # fmt: skip
    parameters = with_changes(data)
    domain = mesh_of(parameters, MPI.COMM_WORLD)
    domain.mesh.geometry.x[:, 0] += inner
    solution = solving.solve_assembled(assemble(parameters, MPI.COMM_WORLD, domain))
    u = solution.displacement
    radius = u.function_space.tabulate_dof_coordinates()[:, 0]
    factor = pressure * (1 + POISSON) / YOUNG * inner**2 / (outer**2 - inner**2)
    exact = factor * ((1 - 2 * POISSON) * radius + outer**2 / radius)
    largest = factor * ((1 - 2 * POISSON) * inner + outer**2 / inner)
    found.add(
        "V25",
        "tube under inner pressure",
        "displacement inside",
        float(u.x.array.reshape(-1, 2)[:, 0].max()),
        largest,
    )
    assert u.x.array.reshape(-1, 2)[:, 0] == pytest.approx(exact, rel=5e-3)


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
    hertz.section(file, 8.0, 1.0, 0.005, dim=2)
    data: dict[str, Any] = {
        "mesh": {"file": str(file), "axisymmetric": True},
        "material": {"elasticity": {"young": hertz.YOUNG, "poisson": hertz.POISSON}},
        "loads": {"displacements": [{"on": "top", "value": [0, 0]}]},
        "contact": {"on": "bottom", "gap": f"x*x/(2*{hertz.RADIUS}) - {hertz.DEPTH}"},
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
    found.add("V25", where, "force", force, hertz.FORCE, rel=0.02)
    found.add("V25", where, "half-width", half_width, hertz.HALF_WIDTH, rel=0.01)
    found.add("V25", where, "peak pressure", peak, hertz.PEAK, rel=0.02)
    found.add(
        "V25",
        where,
        "a^3 over 3FR/(4E*)",
        half_width**3 / (0.75 * force * hertz.RADIUS / hertz.MODULUS),
        1.0,
    )
    assert half_width**3 == pytest.approx(0.75 * force * hertz.RADIUS / hertz.MODULUS, rel=0.02)
    assert by_area == pytest.approx(hertz.HALF_WIDTH, rel=0.03)


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
