"""Contact points come in an order that follows Gamma_C, whatever ranks and numbering did."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contact_locking.arrays import FloatArray
from contact_locking.results.ordering import along_curves, curves, facets_of, lexicographic

pytestmark = pytest.mark.serial


def _polyline(points: FloatArray, closed: bool = False) -> FloatArray:
    ends = np.roll(points, -1, axis=0) if closed else points[1:]
    return np.stack([points[: len(ends)], ends], axis=1)


@given(seed=st.integers(0, 1000))
def test_points_of_an_arc_are_walked_from_its_first_end(seed: int) -> None:
    angle = np.linspace(-0.9 * np.pi, 0.6 * np.pi, 30)
    arc = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    shuffled = np.random.default_rng(seed).permutation(arc)
    order = along_curves(shuffled, _polyline(arc))
    assert np.array_equal(shuffled[order], arc)


def test_a_closed_curve_starts_at_its_first_point_and_goes_round_once() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    order = along_curves(square, _polyline(square, closed=True))
    assert np.array_equal(square[order], square[[0, 3, 2, 1]])


def test_separate_curves_come_one_after_the_other() -> None:
    left = np.array([[0.0, 0.0], [0.0, 1.0]])
    right = np.array([[2.0, 0.0], [3.0, 0.0], [4.0, 0.0]])
    points = np.concatenate([right, left])
    segments = np.concatenate([_polyline(right), _polyline(left)])
    order = along_curves(points, segments)
    assert np.array_equal(points[order], np.concatenate([left, right]))


def test_rounding_in_one_coordinate_does_not_disturb_the_order_in_the_next() -> None:
    points = np.array([[1e-16, 1.0], [0.0, 2.0], [-1e-16, 3.0]])
    assert np.array_equal(lexicographic(points), [0, 1, 2])


def test_facets_are_numbers_of_points_each_once_in_an_order_of_its_own() -> None:
    points = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    first, second = points[[2, 0, 1]], points[[3, 2, 1]]
    corners = np.stack([second, first, first[[1, 2, 0]]]) + 1e-15
    assert facets_of(points, corners).tolist() == [[0, 1, 2], [1, 2, 3]]


def test_curves_are_lines_of_point_numbers_and_a_closed_one_repeats_its_first() -> None:
    segments = np.array([[4, 2], [0, 1], [2, 3], [5, 6], [6, 7], [7, 5]])
    assert [list(line) for line in curves(segments)] == [[0, 1], [3, 2, 4], [5, 6, 7, 5]]
    apart = np.array([[0, 1], [2, 3], [3, 4]])
    assert [list(line) for line in curves(apart)] == [[0, 1], [2, 3, 4]]
    assert curves(np.empty((0, 2), dtype=np.int64)) == []


def test_an_order_along_curves_that_meet_has_each_point_once() -> None:
    cross = np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0], [2.0, 0.0]])
    segments = np.stack([cross[[0, 1, 3, 1]], cross[[1, 2, 1, 4]]], axis=1)
    assert sorted(map(int, along_curves(cross, segments))) == [0, 1, 2, 3, 4]
