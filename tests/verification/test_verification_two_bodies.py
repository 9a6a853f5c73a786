"""V53 to V57: two bodies of published benchmarks: punches, cylinders, a roller, a heated pellet."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from benchmark_bodies import (
    COMPRESSION,
    RADIUS,
    cylinder_study,
    cylinders,
    moved,
    pellet,
    pellet_study,
    punch_study,
    punch_with_fillet,
    roller,
    roller_study,
    solved,
)
from rounded_punch import (
    APPROACH,
    CONTACT,
    FORCE,
    MEAN,
    quarter_of_rounded_punch,
    rounded_punch,
    rounded_punch_study,
)
from verification_table import Row

from contact_locking.results.contact_points import STICK

pytest.importorskip("gmsh")
# Gmsh meshes on one rank.
pytestmark = pytest.mark.serial

TEST = "test_verification_two_bodies.py"


@pytest.mark.parametrize("sides", [("sole", "face"), ("face", "sole")])
def test_v53_a_flat_punch_with_a_round_edge(
    sides: tuple[str, str], tmp_path: Path, found: list[Row]
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
    found += [
        Row("V53", told, "force", force, FORCE, TEST),
        Row("V53", told, "radius of the contact", radius, CONTACT, TEST),
        Row("V53", told, "mean pressure", mean, MEAN, TEST),
    ]
    assert force == pytest.approx(FORCE, rel=0.005)
    assert radius == pytest.approx(CONTACT, rel=0.01)
    assert mean == pytest.approx(MEAN, rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(("cells", "error"), [("box", 0.015), ("simplex", 0.055)])
def test_v53_in_space(cells: str, error: float, tmp_path: Path, found: list[Row]) -> None:
    """A quarter of the punch with 7 facets of the sole over the radius of the contact.

    Tetrahedra of degree 1 are stiffer than hexahedra.
    """
    study = rounded_punch_study(quarter_of_rounded_punch(tmp_path, cells, 2.0), dim=3)
    solution = solved(study)
    force, area = 4.0 * solution.summary["contact_force"][2], 4.0 * solution.summary["contact_area"]
    told = f"a flat punch with a round edge, {'hexa' if cells == 'box' else 'tetra'}hedra"
    radius = math.sqrt(area / math.pi)
    found += [
        Row("V53", told, "force", force, FORCE, TEST),
        Row("V53", told, "radius of the contact", radius, CONTACT, TEST),
    ]
    assert force == pytest.approx(FORCE, rel=error)
    # To half a facet.
    assert radius == pytest.approx(CONTACT, abs=1.0)


@pytest.mark.parametrize("sides", [("arc_upper", "arc_lower"), ("arc_lower", "arc_upper")])
def test_v54_equal_cylinders_under_a_shear_force(
    sides: tuple[str, str], tmp_path: Path, found: list[Row]
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
    found += [
        Row("V54", told, "half-width", half, a, TEST),
        Row("V54", told, "half-width of the zone that sticks", zone, c, TEST),
        Row("V54", told, "largest shear traction", traction, largest, TEST),
    ]
    # To a facet.
    assert half == pytest.approx(0.681, abs=fine) and a == pytest.approx(0.681, abs=5e-4)
    assert zone == pytest.approx(0.497, abs=fine)
    assert stuck.max() == pytest.approx(-stuck.min(), abs=fine)
    assert traction == pytest.approx(largest, rel=0.04)


def test_v55_a_heated_pellet_in_its_cladding(tmp_path: Path, found: list[Row]) -> None:
    """Lame in plane strain: the pellet grows by ``(1 + nu) alpha T r`` and presses the cladding."""
    solution = solved(pellet_study(pellet(tmp_path)))
    points = solution.contact_points
    assert points is not None
    inner, outer = 4.12, 4.75
    of_pellet = 1.3 * 0.4 * 4.1 / 2e5
    of_cladding = 1.3 / 1e5 * inner * (0.4 * inner**2 + outer**2) / (outer**2 - inner**2)
    exact = (1.3 * 1e-2 * 4.1 - 0.02) / (of_pellet + of_cladding)
    pressure, told = float(points.pressure.mean()), "a heated pellet in its cladding, with friction"
    found.append(Row("V55", told, "pressure", pressure, exact, TEST))
    used = np.abs(points.traction).max() / points.bound.max()
    found.append(Row("V55", told, "friction over its bound", used, 0.0, TEST))
    assert exact == pytest.approx(114.04, abs=0.005)
    assert points.pressure == pytest.approx(exact, rel=1e-3) and used < 1e-3


@pytest.mark.parametrize("sides", [("face", "arc"), ("arc", "face")])
def test_v56_a_steel_roller_on_an_aluminium_block(
    sides: tuple[str, str], tmp_path: Path, found: list[Row]
) -> None:
    """NAFEMS contact benchmark 1, without friction: Hertz between half spaces."""
    study = roller_study(roller(tmp_path, 0.2), mu=0.0)
    solution = solved(study, contact=dict(zip(("on", "against"), sides, strict=True)))
    modulus = 1.0 / ((1.0 - 0.3**2) * (1.0 / 210e3 + 1.0 / 70e3))
    half = math.sqrt(4.0 * 35e3 * 50.0 / (math.pi * modulus))
    peak = 2.0 * 35e3 / (math.pi * half)
    width, pressure = solution.summary["contact_area"], solution.summary["pressure_max"]
    told = f"NAFEMS contact benchmark 1, mu = 0, {sides[0]} with the conditions"
    found += [
        Row("V56", told, "half-width", width, half, TEST),
        Row("V56", told, "peak pressure", pressure, peak, TEST),
    ]
    assert width == pytest.approx(half, abs=0.2)
    # Chords of the arc are up to h^2/(8 R) beside it, of which pressures see 1 %.
    assert pressure == pytest.approx(peak, rel=0.015)


def test_v56_the_friction_of_a_roller_does_not_depend_on_the_side(
    tmp_path: Path, found: list[Row]
) -> None:
    """NAFEMS contact benchmark 1 with mu = 0.1, whose force grows in 20 steps."""
    study = roller_study(roller(tmp_path, 0.4), steps=20)
    totals = []
    for on, against in (("face", "arc"), ("arc", "face")):
        solution = solved(study, contact={"on": on, "against": against})
        totals.append(abs(solution.summary["friction_force"][0]))
    told = "NAFEMS contact benchmark 1, mu = 0.1, 20 steps"
    quantity = "total friction of the half, arc with the conditions for face"
    found.append(Row("V56", told, quantity, totals[1], totals[0], TEST))
    assert totals[1] == pytest.approx(totals[0], rel=0.002)


@pytest.mark.parametrize(("mu", "known"), [(0.0, -0.1338), (0.1, -0.1316)])
@pytest.mark.parametrize("sides", [("sole", "face"), ("face", "sole")])
def test_v57_a_steel_punch_with_a_fillet_on_an_aluminium_block(
    sides: tuple[str, str], mu: float, known: float, tmp_path: Path, found: list[Row]
) -> None:
    """NAFEMS contact benchmark 2: the displacement of the middle of the block's top.

    Known are the values to which nodes against segments go as cells become smaller.
    """
    study = punch_study(punch_with_fillet(tmp_path, 0.8, 0.15), mu)
    down = moved(solved(study, contact=dict(zip(("on", "against"), sides, strict=True))))
    told = f"NAFEMS contact benchmark 2, mu = {mu:g}, fine mesh, {sides[0]} with the conditions"
    found.append(Row("V57", told, "displacement of the middle", down, known, TEST))
    assert down == pytest.approx(known, rel=0.003)


@pytest.mark.parametrize(("mu", "published"), [(0.0, -0.1329), (0.1, -0.1308)])
def test_v57_on_a_coarse_mesh_the_punch_sinks_less_deep(
    mu: float, published: float, tmp_path: Path, found: list[Row]
) -> None:
    """Published are results of several programs on coarse meshes, which are too stiff.

    The edge of the flat part, where pressures are largest, is between nodes that are far apart.
    """
    study = punch_study(punch_with_fillet(tmp_path, 2.0, 2.0), mu)
    down = moved(solved(study))
    told = f"NAFEMS contact benchmark 2, mu = {mu:g}, coarse mesh, beside those published"
    found.append(Row("V57", told, "displacement of the middle", down, published, TEST))
    assert down == pytest.approx(published, rel=0.01)
