"""Two bodies of published benchmarks on meshes that do not match, with either side as `on`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_bodies import (
    COMPRESSION,
    cylinder,
    cylinder_on_block,
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
from rounded_punch import FORCE, quarter_of_rounded_punch, rounded_punch_study
from slow import slow

from contact_locking import StudySolution
from contact_locking.arrays import FloatArray
from contact_locking.results.contact_points import OPEN, STICK, ContactPoints

pytest.importorskip("gmsh")
# Gmsh meshes on one rank.
pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("meshes")


def points_of(solution: StudySolution) -> ContactPoints:
    assert solution.contact_points is not None
    return solution.contact_points


def both_roles(*sides: str) -> list[dict[str, str]]:
    return [{"on": on, "against": against} for on, against in (sides, sides[::-1])]


def forces_about_axis(solution: StudySolution) -> FloatArray:
    """The pressure of each node times the integral of its basis function over its facets."""
    points, facets = points_of(solution), solution.contact_facets
    assert facets is not None
    ends = points.x[facets]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    radius = ends[:, :, 0]
    areas = np.zeros(len(points))
    for own, other in ((0, 1), (1, 0)):
        share = math.pi * length * (2.0 * radius[:, own] + radius[:, other]) / 3.0
        np.add.at(areas, facets[:, own], share)
    return points.pressure * areas


# Nodes against segments on such a mesh, and fine meshes, to which degree 2 is near.
@pytest.mark.parametrize(("degree", "known"), [(1, -0.1311), (2, -0.1338)])
@pytest.mark.parametrize("contact", both_roles("sole", "face") + both_roles("flat", "face"))
def test_a_punch_with_a_fillet_sinks_as_deep_as_by_nodes_and_segments(
    contact: dict[str, str], degree: int, known: float, folder: Path
) -> None:
    study = punch_study(punch_with_fillet(folder, 4.0, 4.0))
    solution = solved(study, contact=contact, discretisation={"degree": degree})
    assert moved(solution) == pytest.approx(known, rel=0.02)
    points = points_of(solution)
    touching = (points.x[:, 0] < 39.0) & (points.pressure > 0.0)
    assert touching.sum() == (points.x[:, 0] < 39.0).sum()
    if degree == 1 and "sole" in contact.values():
        # The node at the edge bears 284 kN by nodes against segments.
        forces = forces_about_axis(solution)
        assert forces.max() < 1.05 * 284e3
        assert abs(points.x[forces.argmax(), 0] - 40.0) < 4.0


@pytest.mark.parametrize("contact", both_roles("arc_upper", "face"))
def test_a_very_stiff_block_is_a_rigid_floor(contact: dict[str, str], folder: Path) -> None:
    stiff = {"lower": {"elasticity": {"young": 2e7, "poisson": 0.3}}}
    study = cylinder_study(cylinder_on_block(folder, 0.1), 0.1, -0.12)
    study["material"]["regions"] = stiff
    on_block = solved(study, contact=contact)
    alone = cylinder_study(cylinder(folder, 0.1), 0.1, -0.12)
    loads = {"displacements": [{"on": "flat_upper", "value": [0.0, -0.12]}]}
    floor = {"half_space": {"point": [0.0, 0.0], "normal": [0.0, 1.0]}}
    on_floor = solved(alone, loads=loads, contact={"on": "arc_upper", "foundation": floor})

    def tractions(solution: StudySolution) -> FloatArray:
        points = points_of(solution)
        order = np.argsort(points.x[:, 0])
        places = [-0.6, -0.4, 0.4, 0.6]
        return np.interp(places, points.x[order, 0], points.traction[order, 0])

    sign = 1.0 if contact["on"] == "arc_upper" else -1.0
    assert sign * tractions(on_block) == pytest.approx(tractions(on_floor), rel=0.05)
    assert on_block.summary["pressure_max"] == pytest.approx(
        on_floor.summary["pressure_max"], rel=0.05
    )


# Chords of circles that do not match have gaps, of which friction sees some per cent.
@pytest.mark.parametrize(("ratio", "share"), [(1.0, 0.01), (1.3, 0.06)])
@pytest.mark.parametrize("contact", both_roles("arc_upper", "arc_lower"))
def test_equal_cylinders_do_not_rub_as_they_are_pressed(
    contact: dict[str, str], ratio: float, share: float, folder: Path
) -> None:
    fine = 0.1 if ratio == 1.0 else 0.05
    study = cylinder_study(cylinders(folder, fine, ratio), 0.2, -COMPRESSION)
    solution = solved(study, contact=contact)
    points = points_of(solution)
    assert np.abs(points.traction[:, 0]).max() < share * points.bound.max()
    assert solution.summary["contact_force"][1] == pytest.approx(
        10.0 if contact["on"] == "arc_upper" else -10.0, rel=0.01
    )


@pytest.mark.parametrize("steps", [0, 10])
def test_a_roller_has_the_same_friction_whichever_side_is_on(steps: int, folder: Path) -> None:
    study = roller_study(roller(folder, 0.8), steps=steps)
    face, arc = (solved(study, contact=contact) for contact in both_roles("face", "arc"))
    total = [abs(one.summary["friction_force"][0]) for one in (face, arc)]
    assert total[0] == pytest.approx(total[1], rel=0.02)
    assert total[0] > 0.5 * 0.1 * 17500.0
    assert moved(face) == pytest.approx(moved(arc), rel=1e-3)
    # The middle is held in both bodies, and cannot slip.
    for points in map(points_of, (face, arc)):
        middle = np.abs(points.x[:, 0]) < 1e-9
        assert np.all(points.state[middle] == STICK)


@pytest.mark.parametrize("contact", both_roles("arc_upper", "arc_lower"))
def test_sheared_cylinders_stick_where_cattaneo_and_mindlin_say(
    contact: dict[str, str], folder: Path
) -> None:
    """In two steps, of which the first one presses by P = 10 and the second one shears by Q."""
    fine, mu = 0.05, 0.2
    down, aside = f"{-COMPRESSION}*min(t, 1)", "0.0297*max(t - 1, 0)"
    study = cylinder_study(cylinders(folder, fine), mu, down, aside)
    solution = solved(study, contact=contact, steps={"to": 2, "count": 2})
    shear, force = (abs(value) for value in solution.summary["reactions"]["flat_upper"])
    assert shear == pytest.approx(0.94, rel=0.01) and force == pytest.approx(10.0, rel=0.01)
    points = points_of(solution)
    stuck = points.x[points.state == STICK, 0]
    assert stuck.max() == pytest.approx(-stuck.min(), abs=fine)
    # A node that sticks has half of both facets beside it.
    zone = solution.summary["contact_area"] - solution.summary["slip_area"]
    assert 0.5 * zone == pytest.approx(0.497, abs=fine)


def test_a_heated_pellet_neither_slips_nor_rubs_in_its_cladding(folder: Path) -> None:
    """The pressure is that of Lame in plane strain; both bodies are held along the axis."""
    solution = solved(pellet_study(pellet(folder)))
    points = points_of(solution)
    assert points.pressure == pytest.approx(114.04, rel=1e-3)
    assert np.all(points.state == STICK)
    assert np.abs(points.traction).max() < 1e-3 * points.bound.max()


def stacked(dim: int, contact: dict[str, str], **mesh: Any) -> dict[str, Any]:
    return {
        "mesh": {"builder": "stack", "dim": dim} | mesh,
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "contact": contact,
    }


def pressed(dim: int, by: float) -> dict[str, Any]:
    held = [("bottom", [0.0] * dim), ("top", [0.0] * (dim - 1) + [-by])]
    return {"displacements": [{"on": on, "value": value} for on, value in held]}


def beyond(points: ContactPoints, size: float, axis: int = 0) -> float:
    """How far points under pressure are outside of 0 < x < size along an axis."""
    x = points.x[points.state != OPEN, axis]
    return max(-x.min(), x.max() - size, 0.0)


BLOCKS = both_roles("upper_bottom", "lower_top")


@pytest.mark.parametrize("contact", BLOCKS)
@pytest.mark.parametrize("dim", [2, 3])
def test_a_block_under_a_wide_plate_has_a_constant_pressure(
    dim: int, contact: dict[str, str]
) -> None:
    sizes = {"size": [0.9] * (dim - 1) + [0.8], "upper": [1.33] * (dim - 1) + [0.5]}
    study = stacked(dim, contact, h=0.4, **sizes)
    stiff = {"upper": {"elasticity": {"young": 1e4, "poisson": 0.0}}}
    study["material"] = {"elasticity": {"young": 1.0, "poisson": 0.0}, "regions": stiff}
    solution = solved(study, loads=pressed(dim, 0.01), friction=friction(0.2))
    assert solution.summary["pressure_max"] == pytest.approx(0.0125, rel=0.15)
    force = abs(solution.summary["contact_force"][-1])
    assert force == pytest.approx(0.0125 * 0.9 ** (dim - 1), rel=1e-3)


@pytest.mark.parametrize("contact", BLOCKS)
@pytest.mark.parametrize("h_upper", [0.07, 0.055, 0.037, 0.033])
def test_no_pressure_is_a_force_over_a_sliver(h_upper: float, contact: dict[str, str]) -> None:
    """The last facet of the wider block is cut in any ratio.

    At the edge the pressure grows as a weak power of the distance, to 2 times the mean at a facet
    of 0.033 or 0.037.
    """
    study = stacked(2, contact, size=[1.0, 0.5], upper=[1.2, 0.5], h=0.1, h_upper=h_upper)
    solution = solved(study, loads=pressed(2, 0.02))
    mean = abs(solution.summary["contact_force"][1])
    assert mean == pytest.approx(0.025, rel=0.02)
    assert solution.summary["pressure_max"] < 2.1 * mean
    assert beyond(points_of(solution), 1.0) <= 0.5 * h_upper


@pytest.mark.parametrize("contact", BLOCKS)
def test_crossed_blocks_press_only_where_they_face_each_other(contact: dict[str, str]) -> None:
    """The upper block is wider along x, and the lower one along y."""
    sizes = {"size": [1.0, 1.0, 0.5], "upper": [1.2, 0.8, 0.5]}
    study = stacked(3, contact, h=0.2, h_upper=0.13, **sizes)
    solution = solved(study, loads=pressed(3, 0.02))
    assert abs(solution.summary["contact_force"][2]) == pytest.approx(0.0204, rel=0.01)
    points = points_of(solution)
    assert beyond(points, 1.0) <= 0.065
    points.x[:, 1] -= 0.1
    assert beyond(points, 0.8, axis=1) <= 0.1


@pytest.mark.parametrize("contact", BLOCKS)
def test_a_seal_under_a_wider_holder_has_no_pressure_beyond_its_rim(
    contact: dict[str, str],
) -> None:
    study = stacked(2, contact, size=[20.0, 8.0], upper=[26.0, 6.0], h=1.0)
    soft, stiff = {"young": 5.0, "poisson": 0.45}, {"young": 2000.0, "poisson": 0.4}
    regions = {
        "lower": {"elasticity": soft, "locking_limit": 0.2},
        "upper": {"elasticity": stiff},
    }
    study["material"] = {"regions": regions}
    solution = solved(study, loads=pressed(2, 0.4), friction={"coefficient": 0.3})
    mean = abs(solution.summary["contact_force"][1]) / 20.0
    assert solution.summary["pressure_max"] < 2.5 * mean
    assert beyond(points_of(solution), 20.0) <= 0.5


# With 4 facets over the radius of the contact; tetrahedra of degree 1 are stiffer.
@pytest.mark.parametrize(("cells", "error"), [("box", 0.03), slow("simplex", 0.1)])
@pytest.mark.parametrize("contact", both_roles("sole", "face"))
def test_a_punch_with_a_round_edge_in_space_is_that_of_theory(
    contact: dict[str, str], cells: str, error: float, folder: Path
) -> None:
    study = rounded_punch_study(quarter_of_rounded_punch(folder, cells, 3.4), dim=3)
    solution = solved(study, contact=contact)
    assert 4.0 * abs(solution.summary["contact_force"][2]) == pytest.approx(FORCE, rel=error)
    # The largest pressure is 995 near the edge of the flat part, and nodes differ in their shares.
    assert solution.summary["pressure_max"] < (1.1 if cells == "box" else 1.4) * 995.0
