"""The pairing of two sides by their geometry alone."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay

from contact_locking.arrays import FloatArray
from contact_locking.contact.pairing import Pairing, Side, pair
from contact_locking.mesh.cell_kind import INTERVAL, QUADRILATERAL, TRIANGLE, unit_normals

pytestmark = pytest.mark.serial

PLANE = {2: np.array([0.3]), 3: np.array([0.2, -0.1])}


def curve(points: Any, sign: float) -> Side:
    """The segments between points (k, 2) in their order, with normals to one side of them."""
    numbers = np.arange(len(points))
    facets = np.stack([numbers[:-1], numbers[1:]], axis=1)
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    return Side(points, INTERVAL, facets, sign * np.stack([-along[:, 1], along[:, 0]], axis=1))


def flat(dim: int, n: int, height: float, sign: float, low: Any, high: Any) -> Side:
    """An irregular mesh on a part of the inclined plane, with normals up or down."""
    random = np.random.default_rng(n)
    grid = np.linspace(0.0, 1.0, n + 1)
    at: Any = np.stack(np.meshgrid(*[grid] * (dim - 1)), axis=-1).reshape(-1, dim - 1)
    inside = (at > 0.0) & (at < 1.0)
    at = at + inside * (random.random(at.shape) - 0.5) * 0.5 / n
    at = np.asarray(low) + at * np.subtract(high, low)
    points = np.column_stack([at, at @ PLANE[dim] + height])
    if dim == 2:
        return curve(points, sign)
    facets = Delaunay(at).simplices
    x = points[facets]
    normals = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    normals /= (sign * np.sign(normals[:, 2]) * np.linalg.norm(normals, axis=1))[:, None]
    return Side(points, TRIANGLE, facets, normals)


def quadrilaterals(n: int, sign: float, share: float, warp: float = 0.0) -> Side:
    """Moved quadrilaterals on the inclined plane, whose corners ``warp`` lifts off it."""
    grid: Any = np.stack(np.meshgrid(*[np.arange(n + 1)] * 2), axis=-1).reshape(-1, 2)
    steps = np.random.default_rng(n).uniform(-share, share, grid.shape)
    steps[(grid == 0) | (grid == n)] = 0.0
    at = (grid + steps) / n
    height = at @ PLANE[3] + warp * np.prod(2.0 * at - 1.0, axis=1)
    first = (grid[:, 0] < n) & (grid[:, 1] < n)
    facets = np.flatnonzero(first)[:, None] + np.array([0, 1, n + 1, n + 2])
    points = np.column_stack([at, height])
    return Side(points, QUADRILATERAL, facets, sign * unit_normals(points[facets]))


def areas(side: Side) -> FloatArray:
    """The integrals of the functions of the nodes of quadrilaterals, by Gauss's rule."""
    found = np.zeros(len(side.points))
    places = 0.5 + np.array([[i, j] for i in (-1, 1) for j in (-1, 1)]) / math.sqrt(12.0)
    a, b, c, d = np.moveaxis(side.corners, 1, 0)
    for s, t, values in zip(*places.T, QUADRILATERAL.basis(places), strict=True):
        normals = np.cross((1 - t) * (b - a) + t * (d - c), (1 - s) * (c - a) + s * (d - b))
        sizes = 0.25 * np.linalg.norm(normals, axis=1)
        np.add.at(found, side.facets, sizes[:, None] * values)
    return found


@pytest.mark.parametrize("share", [0.0, 0.25])
def test_quadrilaterals_share_affine_fields_and_areas(share: float) -> None:
    """Also where they are no parallelograms."""
    one, two = quadrilaterals(5, 1.0, share), quadrilaterals(7, -1.0, share)
    found = pair(one, two)
    assert found.faces.all() and found.twice is None
    reproduces(found, one, two, 0.0)
    assert found.weights == pytest.approx(areas(one), rel=1e-11)
    assert found.weights @ found.shares == pytest.approx(areas(two), rel=1e-11)


@pytest.mark.parametrize("n", [5, 10])
def test_areas_on_warped_quadrilaterals_are_those_of_mean_planes(n: int) -> None:
    """They err by 1.7 times the square of the height of the corners over the length of a facet."""
    one, two = quadrilaterals(n, 1.0, 0.0, 0.1), quadrilaterals(7 * n // 5, -1.0, 0.0, 0.1)
    away = one.corners - one.corners.mean(axis=1)[:, None]
    height = np.abs(np.einsum("mcd,md->mc", away, one.outward)).max()
    found = pair(one, two)
    bound = 2.0 * (n * height) ** 2
    assert found.weights == pytest.approx(areas(one), rel=bound)
    assert found.weights @ found.shares == pytest.approx(areas(two), rel=bound)
    assert np.abs(found.gap).max() <= 5e-3 * height
    same = pair(one, replace(one, outward=-one.outward))
    assert np.abs(same.gap).max() <= 1e-15
    assert same.shares.toarray() == pytest.approx(np.eye(len(one.points)), abs=1e-12)


def reproduces(found: Pairing, one: Side, two: Side, gap: float) -> None:
    """An affine field has the jump of its gradient over the gap, and the gap is the distance."""
    gradient = np.arange(1.0, one.points.shape[1] + 1.0)
    normal, here = one.outward[0], found.faces
    jump = found.shares @ (two.points @ gradient) - found.near @ (one.points @ gradient)
    assert jump[here] == pytest.approx(gap * gradient @ normal, abs=1e-12)
    assert found.gap[here] == pytest.approx(gap, abs=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("sizes", [(9, 7), (5, 12)])
@pytest.mark.parametrize("gap", [0.04, -0.01])
def test_affine_fields_jump_over_flat_sides_as_they_should(
    dim: int, sizes: tuple[int, int], gap: float
) -> None:
    ends = [-0.2] * (dim - 1), [1.2] * (dim - 1)
    one = flat(dim, sizes[0], 0.0, 1.0, [0.0] * (dim - 1), [1.0] * (dim - 1))
    two = flat(dim, sizes[1], gap / one.outward[0, -1], -1.0, *ends)
    found = pair(one, two)
    assert found.faces.all() and found.twice is None
    reproduces(found, one, two, gap)
    assert found.weights.sum() == pytest.approx(one.sizes().sum(), rel=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_part_that_is_covered_is_cut_exactly(dim: int) -> None:
    low, high = [0.21, 0.1][: dim - 1], [0.57, 1.3][: dim - 1]
    one = flat(dim, 12, 0.0, 1.0, [0.0] * (dim - 1), [1.0] * (dim - 1))
    two = flat(dim, 7, 0.0, -1.0, low, high)
    found = pair(one, two)
    reproduces(found, one, two, 0.0)
    slope = math.sqrt(1.0 + PLANE[dim] @ PLANE[dim])
    covered = slope * math.prod(min(1.0, b) - a for a, b in zip(low, high, strict=True))
    # Less than a thousandth of a facet is left out.
    assert found.weights.sum() == pytest.approx(covered, rel=2e-3)
    assert not found.faces.all()


def circle(radius: float, n: int, sign: float) -> Side:
    angles = np.linspace(0.0, 0.5 * math.pi, n + 1)
    return curve(radius * np.column_stack([np.cos(angles), np.sin(angles)]), sign)


def cylinder(of: Side, floors: int) -> Side:
    """The quadrilaterals above a curve up to the height 1."""
    count = len(of.points)
    points = [np.insert(of.points, 2, z, axis=1) for z in np.linspace(0.0, 1.0, floors + 1)]
    rows = [of.facets + floor * count for floor in range(floors + 1)]
    facets = np.concatenate([np.hstack(pair) for pair in pairwise(rows)])
    outward = np.tile(np.insert(of.outward, 2, 0.0, axis=1), (floors, 1))
    return Side(np.concatenate(points), QUADRILATERAL, facets, outward)


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("dim", [2, 3])
def test_meshes_of_one_circle_that_do_not_match_leave_no_gap(dim: int, swapped: bool) -> None:
    errors = []
    for n in (11, 22):
        sides = circle(1.0, n, -1.0), circle(1.0, 3 * n // 2, 1.0)
        if dim == 3:
            sides = cylinder(sides[0], 2), cylinder(sides[1], 3)
        one, two = sides[::-1] if swapped else sides
        errors.append(np.abs(pair(one, two).gap).max())
    # The sagitta of the coarser facets is 3e-3 and falls by 4.
    assert errors[0] <= 1e-4 and errors[1] <= errors[0] / 6.0


def test_a_ray_that_meets_two_facets_is_told() -> None:
    one = flat(2, 5, 0.0, 1.0, [0.0], [1.0])
    near, far = (flat(2, 5, height, -1.0, [0.0], [1.0]) for height in (0.01, 0.02))
    both = Side(
        np.vstack([near.points, far.points]),
        INTERVAL,
        np.vstack([near.facets, far.facets + len(near.points)]),
        np.vstack([near.outward, far.outward]),
    )
    assert pair(one, both).twice is not None


def test_the_flank_and_the_back_of_a_body_face_nothing() -> None:
    one = flat(2, 5, 0.0, 1.0, [0.0], [1.0])
    back = flat(2, 5, 0.1, 1.0, [0.0], [1.0])
    flank = curve(np.array([[0.4, 0.15], [0.42, 0.6]]), 1.0)
    for other in (back, flank):
        assert not pair(one, other).faces.any()
