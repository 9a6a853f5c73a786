"""V53 to V57: two bodies of published benchmarks: punches, cylinders, a roller, a heated pellet."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_bodies import (
    COMPRESSION,
    RADIUS,
    cylinder_study,
    cylinders,
    friction,
    moved,
    pellet,
    pellet_study,
    punch_study,
    punch_with_fillet,
    roller,
    roller_study,
    solved,
)
from boxes import lattice
from mpi4py import MPI
from outlines import Side, graded, write_outlines
from small_meshes import Groups, Points, shared
from verification_table import Rows

from contact_locking.arrays import FloatArray
from contact_locking.results.contact_points import STICK

pytestmark = pytest.mark.serial


# Radii of the flat part, of the round edge and of the contact; bodies are cut at the distance FAR.
FLAT, ROUND, CONTACT, FAR = 10.0, 100.0, 10.0 / 0.7, 150.0
# The edge is round up to this radius, and the punch is flat again from there.
SHOULDER = 20.0
APPROACH, FORCE, MEAN = 0.321150, 446557.0, 696.504


def rounded_punch(folder: Path, fine: float) -> Path:
    """The half section, with facets of the size ``fine`` or a little smaller in the contact."""
    step = (SHOULDER, _height(SHOULDER))
    punch = [
        Side("sole", (0.0, 0.0)),
        Side("sole", (FLAT, 0.0), (FLAT, ROUND)),
        Side("", step),
        Side("far_upper", (FAR, step[1]), (0.0, step[1])),
        Side("axis", (0.0, FAR + step[1])),
    ]
    space = [
        Side("face", (0.0, 0.0)),
        Side("", (SHOULDER, 0.0)),
        Side("far_lower", (FAR, 0.0), (0.0, 0.0)),
        Side("axis", (0.0, -FAR)),
    ]
    size = graded([(CONTACT, 0.0), (FLAT, 0.0)], fine, 20.0, 4.0, FAR)
    return write_outlines(
        folder / "rounded.msh",
        {"upper": punch, "lower": space},
        lambda x: size(x) * (0.8 if x[1] < 0.0 else 1.0),
    )


def quarter_of_rounded_punch(folder: Path, cells: str, fine: float) -> Path:
    """A quarter in space, x, y > 0, as two blocks of hexahedra ("box") or tetrahedra."""
    points: Points = []
    groups: Groups = {}
    for name, up, size in (("upper", 1.0, fine), ("lower", -1.0, 0.8 * fine)):
        near = np.linspace(0.0, SHOULDER, round(SHOULDER / size) + 1)
        steps = np.cumsum(size * 1.45 ** np.arange(1, 30))
        away = steps[SHOULDER + steps < 0.8 * FAR]
        ticks = np.concatenate([near, SHOULDER + away, [FAR]])
        depth = np.concatenate([[0.0], steps[steps < 0.8 * FAR], [FAR]])
        _add_block(points, groups, name, [ticks, ticks, depth], up, cells)
    return shared(MPI.COMM_WORLD, folder, points, groups)


def _height(radius: float) -> float:
    away = min(max(radius, FLAT), SHOULDER) - FLAT
    return ROUND - math.sqrt(ROUND**2 - away**2)


def _add_block(
    points: Points, groups: Groups, name: str, ticks: list[FloatArray], up: float, cells: str
) -> None:
    """A block over or under z = 0, whose sole is that of the punch if it is the upper one."""
    places, block = lattice([len(axis) - 1 for axis in ticks], cells)
    x, y, z = (axis[place] for axis, place in zip(ticks, places.T, strict=True))
    if up > 0.0:
        z = z + np.vectorize(_height)(np.hypot(x, y)) * (1.0 - z / FAR)
    first, names = len(points), {"body": name, "left": "left", "front": "front"}
    names["bottom"] = "sole" if up > 0.0 else "face"
    points += [tuple(map(float, row)) for row in np.column_stack([x, y, up * z])]
    for side, rows in block.items():
        numbers = [tuple(first + number for number in row) for row in rows]
        group = names.get(side, f"far_{name}")
        groups[group] = [*groups.get(group, []), *numbers]


def rounded_punch_study(path: Path, dim: int = 2) -> dict[str, Any]:
    """Far from the contact both bodies move as half spaces under a force at a point (Boussinesq).

    Between them is the approach of points that are infinitely far away.
    """
    young, poisson = 1e5, 0.3
    factor = FORCE * (1.0 + poisson) / (2.0 * math.pi * young)
    axes = "xyz"[:dim]
    deep = f"abs({axes[-1]})"
    # The expressions are evaluated at all nodes, at the origin too.
    away = f"max(sqrt({' + '.join(f'{axis}**2' for axis in axes)}), 1)"
    aside = f"{factor}*({deep}/{away}**3 - {1.0 - 2.0 * poisson}/({away}*({away} + {deep})))"
    along = f"{factor}*({deep}**2/{away}**3 + {2.0 * (1.0 - poisson)}/{away})"

    def far(up: float, offset: float) -> list[str]:
        return [*(f"{axis}*{aside}" for axis in axes[:-1]), f"{up}*{along} - {offset}"]

    held: list[tuple[str, list[Any]]] = [("axis", [0.0, None])]
    if dim == 3:
        held = [("left", [0.0, None, None]), ("front", [None, 0.0, None])]
    moved = [("far_lower", far(-1.0, 0.0)), ("far_upper", far(1.0, APPROACH))]
    return {
        "mesh": {"file": str(path), "axisymmetric": dim == 2},
        "material": {"elasticity": {"young": young, "poisson": poisson}},
        "loads": {"displacements": [{"on": on, "value": value} for on, value in held + moved]},
        "contact": {"on": "sole", "against": "face"},
        "friction": friction(0.0),
    }


pytest.importorskip("gmsh")


@pytest.mark.parametrize("sides", [("sole", "face"), ("face", "sole")])
def test_v53_a_flat_punch_with_a_round_edge(
    sides: tuple[str, str], tmp_path: Path, found: Rows
) -> None:
    """A flat part of the radius b and then ``(r - b)^2/(2 R)``, on a half space (Ciavarella).

    By Galin and Sneddon, with f' the slope of the profile,
    ``approach = a int_b^a f'/sqrt(a^2 - r^2)`` and ``P = 2 E* int_b^a r^2 f'/sqrt(a^2 - r^2)``.
    """
    study = rounded_punch_study(rounded_punch(tmp_path, 0.3))
    solution = solved(study, contact=dict(zip(("on", "against"), sides, strict=True)))
    force, area = abs(solution.summary["contact_force"][1]), solution.summary["contact_area"]
    told = f"a flat punch with a round edge, approach {APPROACH}, {sides[0]} with the conditions"
    radius, mean = math.sqrt(area / math.pi), force / area
    found.add("V53", told, "force", force, FORCE, rel=0.005)
    found.add("V53", told, "radius of the contact", radius, CONTACT, rel=0.01)
    found.add("V53", told, "mean pressure", mean, MEAN, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("cells", "error"), [("box", 0.015), ("simplex", 0.055)])
def test_v53_in_space(cells: str, error: float, tmp_path: Path, found: Rows) -> None:
    """A quarter of the punch with 7 facets of the sole over the radius of the contact.

    Tetrahedra of degree 1 are stiffer than hexahedra.
    """
    study = rounded_punch_study(quarter_of_rounded_punch(tmp_path, cells, 2.0), dim=3)
    solution = solved(study)
    force, area = 4.0 * solution.summary["contact_force"][2], 4.0 * solution.summary["contact_area"]
    told = f"a flat punch with a round edge, {'hexa' if cells == 'box' else 'tetra'}hedra"
    radius = math.sqrt(area / math.pi)
    found.add("V53", told, "force", force, FORCE, rel=error)
    # To half a facet.
    found.add("V53", told, "radius of the contact", radius, CONTACT, abs=1.0)


@pytest.mark.parametrize("sides", [("arc_upper", "arc_lower"), ("arc_lower", "arc_upper")])
def test_v54_equal_cylinders_under_a_shear_force(
    sides: tuple[str, str], tmp_path: Path, found: Rows
) -> None:
    """Cattaneo and Mindlin: ``q = mu p0 (sqrt(1 - (x/a)^2) - (c/a) sqrt(1 - (x/c)^2))``.

    The mesh is the mirror image of itself.  One step presses, and the next one shears.
    """
    fine, mu, press, shear = 0.025, 0.2, 10.0, 0.94
    study = cylinder_study(
        cylinders(tmp_path, fine), mu, f"-{COMPRESSION}*min(t, 1)", "0.0297*max(t - 1, 0)"
    )
    solution = solved(
        study,
        contact=dict(zip(("on", "against"), sides, strict=True)),
        steps={"to": 2, "count": 2},
    )
    stiffness = 0.5 * 200.0 / (1.0 - 0.3**2)
    a = math.sqrt(4.0 * press * 0.5 * RADIUS / (math.pi * stiffness))
    c = a * math.sqrt(1.0 - shear / (mu * press))
    largest = mu * 2.0 * press / (math.pi * a) * math.sqrt(1.0 - (c / a) ** 2)
    forces = [abs(value) for value in solution.summary["reactions"]["flat_upper"]]
    points = solution.contact_points
    assert points is not None and forces == pytest.approx([shear, press], rel=0.01)
    half = 0.5 * solution.summary["contact_area"]
    stuck = points.x[points.state == STICK, 0]
    # A node that sticks has half of both facets beside it.
    zone = half - 0.5 * solution.summary["slip_area"]
    traction = np.linalg.norm(points.traction, axis=1).max()
    told = f"two equal cylinders, P = 10, Q = 0.94, {sides[0]} with the conditions"
    found.add("V54", told, "half-width", half, a)
    found.add("V54", told, "half-width of the zone that sticks", zone, c)
    found.add("V54", told, "largest shear traction", traction, largest, rel=0.04)
    # To a facet.
    assert half == pytest.approx(0.681, abs=fine) and a == pytest.approx(0.681, abs=5e-4)
    assert zone == pytest.approx(0.497, abs=fine)
    assert stuck.max() == pytest.approx(-stuck.min(), abs=fine)


def test_v55_a_heated_pellet_in_its_cladding(tmp_path: Path, found: Rows) -> None:
    """Lame in plane strain: the pellet grows by ``(1 + nu) alpha T r`` and presses the cladding."""
    solution = solved(pellet_study(pellet(tmp_path)))
    points = solution.contact_points
    assert points is not None
    inner, outer = 4.12, 4.75
    of_pellet = 1.3 * 0.4 * 4.1 / 2e5
    of_cladding = 1.3 / 1e5 * inner * (0.4 * inner**2 + outer**2) / (outer**2 - inner**2)
    exact = (1.3 * 1e-2 * 4.1 - 0.02) / (of_pellet + of_cladding)
    pressure, told = float(points.pressure.mean()), "a heated pellet in its cladding, with friction"
    found.add("V55", told, "pressure", pressure, exact)
    used = np.abs(points.traction).max() / points.bound.max()
    found.add("V55", told, "friction over its bound", used, 0.0)
    assert exact == pytest.approx(114.04, abs=0.005)
    assert points.pressure == pytest.approx(exact, rel=1e-3) and used < 1e-3


@pytest.mark.parametrize("sides", [("face", "arc"), ("arc", "face")])
def test_v56_a_steel_roller_on_an_aluminium_block(
    sides: tuple[str, str], tmp_path: Path, found: Rows
) -> None:
    """NAFEMS contact benchmark 1, without friction: Hertz between half spaces."""
    study = roller_study(roller(tmp_path, 0.2), mu=0.0)
    solution = solved(study, contact=dict(zip(("on", "against"), sides, strict=True)))
    modulus = 1.0 / ((1.0 - 0.3**2) * (1.0 / 210e3 + 1.0 / 70e3))
    half = math.sqrt(4.0 * 35e3 * 50.0 / (math.pi * modulus))
    peak = 2.0 * 35e3 / (math.pi * half)
    width, pressure = solution.summary["contact_area"], solution.summary["pressure_max"]
    told = f"NAFEMS contact benchmark 1, mu = 0, {sides[0]} with the conditions"
    found.add("V56", told, "half-width", width, half, abs=0.2)
    # Chords of the arc are up to h^2/(8 R) beside it, of which pressures see 1 %.
    found.add("V56", told, "peak pressure", pressure, peak, rel=0.015)


def test_v56_the_friction_of_a_roller_does_not_depend_on_the_side(
    tmp_path: Path, found: Rows
) -> None:
    """NAFEMS contact benchmark 1 with mu = 0.1, whose force grows in 20 steps."""
    study = roller_study(roller(tmp_path, 0.4), steps=20)
    totals = []
    for on, against in (("face", "arc"), ("arc", "face")):
        solution = solved(study, contact={"on": on, "against": against})
        totals.append(abs(solution.summary["friction_force"][0]))
    told = "NAFEMS contact benchmark 1, mu = 0.1, 20 steps"
    quantity = "total friction of the half, arc with the conditions for face"
    found.add("V56", told, quantity, totals[1], totals[0], rel=0.002)


@pytest.mark.parametrize(("mu", "known"), [(0.0, -0.1338), (0.1, -0.1316)])
@pytest.mark.parametrize("sides", [("sole", "face"), ("face", "sole")])
def test_v57_a_steel_punch_with_a_fillet_on_an_aluminium_block(
    sides: tuple[str, str], mu: float, known: float, tmp_path: Path, found: Rows
) -> None:
    """NAFEMS contact benchmark 2: the displacement of the middle of the block's top.

    Known are the values to which nodes against segments go as cells become smaller.
    """
    study = punch_study(punch_with_fillet(tmp_path, 0.8, 0.15), mu)
    down = moved(solved(study, contact=dict(zip(("on", "against"), sides, strict=True))))
    told = f"NAFEMS contact benchmark 2, mu = {mu:g}, fine mesh, {sides[0]} with the conditions"
    found.add("V57", told, "displacement of the middle", down, known, rel=0.003)


@pytest.mark.parametrize(("mu", "published"), [(0.0, -0.1329), (0.1, -0.1308)])
def test_v57_on_a_coarse_mesh_the_punch_sinks_less_deep(
    mu: float, published: float, tmp_path: Path, found: Rows
) -> None:
    """Published are results of several programs on coarse meshes, which are too stiff.

    The edge of the flat part, where pressures are largest, is between nodes that are far apart.
    """
    study = punch_study(punch_with_fillet(tmp_path, 2.0, 2.0), mu)
    down = moved(solved(study))
    told = f"NAFEMS contact benchmark 2, mu = {mu:g}, coarse mesh, beside those published"
    found.add("V57", told, "displacement of the middle", down, published, rel=0.01)
