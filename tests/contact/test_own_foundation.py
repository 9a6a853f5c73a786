"""A foundation of a shape that the package does not have: one class and one entry of a table."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from slow import slow

from contact_locking import (
    Contact,
    Foundation,
    InputError,
    StudySolution,
    from_mapping,
    solve,
)
from contact_locking.arrays import FloatArray
from contact_locking.shapes.shape import Distance, Shape

pytestmark = pytest.mark.serial

GAP = 0.005


@dataclass(frozen=True)
class Capsule:
    """``phi(x) = |x - s(x)| - radius``, with s(x) the point of a segment that is nearest to x."""

    start: tuple[float, ...]
    end: tuple[float, ...]
    radius: float

    def _away(self, x: FloatArray) -> FloatArray:
        """``x - s(x)`` (d, k)."""
        start, end = (np.array(point)[:, None] for point in (self.start, self.end))
        along = end - start
        share = np.sum((x - start) * along, axis=0) / max(float(np.sum(along**2)), 1e-300)
        return x - start - np.clip(share, 0.0, 1.0) * along

    def gap(self, x: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.norm(self._away(x), axis=0) - self.radius)

    def contact_normal(self, x: FloatArray) -> FloatArray:
        away = self._away(x)
        return -away / np.linalg.norm(away, axis=0)


@dataclass(frozen=True)
class Wedge:
    """``phi(x) = max_i n_i . (x - edge)``: half spaces with unit normals n_i, intersected."""

    edge: tuple[float, ...]
    normals: tuple[tuple[float, ...], ...]

    def _heights(self, x: FloatArray) -> FloatArray:
        return np.array(self.normals) @ (x - np.array(self.edge)[:, None])

    def gap(self, x: FloatArray) -> FloatArray:
        return np.asarray(self._heights(x).max(axis=0))

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return -np.array(self.normals)[self._heights(x).argmax(axis=0)].T


def on(foundation: dict[str, Any], dim: int, comm: MPI.Intracomm) -> StudySolution:
    h = 0.2 if dim == 2 else 0.5
    return solve(block(dim, h, contact={"on": "bottom", "foundation": foundation}), comm)


def flat(dim: int) -> tuple[Distance, dict[str, Any]]:
    """A capsule along x, longer than the body, has a flat side in 2D."""
    depth = 1.0 + GAP
    plane = {"half_space": {"point": [0.0, -GAP], "normal": [0.0, 1.0]}}
    return Capsule((-1.0, -depth), (2.0, -depth), 1.0), plane


def round_end(dim: int) -> tuple[Distance, dict[str, Any]]:
    """A capsule without a length is a sphere."""
    centre = (*[0.4] * (dim - 1), -3.0)
    return Capsule(centre, centre, 2.995), {"sphere": {"centre": list(centre), "radius": 2.995}}


def long(dim: int) -> tuple[Distance, dict[str, Any]]:
    """A capsule that is longer than the body is a cylinder."""
    cylinder = {"cylinder": {"centre": [0.4, 0.0, -3.0], "radius": 2.995, "axis": [0.0, 1.0, 0.0]}}
    return Capsule((0.4, -1.0, -3.0), (0.4, 2.0, -3.0), 2.995), cylinder


def one_sided(dim: int) -> tuple[Distance, dict[str, Any]]:
    """A wedge whose edge is beside the body touches with one inclined plane."""
    size = math.hypot(0.02, 1.0)
    incline = (-0.02 / size, *[0.0] * (dim - 2), 1.0 / size)
    edge = (-0.5, *[0.0] * (dim - 2), -0.02)
    left = (-1.0, *[0.0] * (dim - 1))
    plane = {"half_space": {"point": list(edge), "normal": list(incline)}}
    return Wedge(edge, (incline, left)), plane


@pytest.mark.parametrize(
    ("make", "dim"),
    [
        (flat, 2),
        (round_end, 2),
        slow(round_end, 3),
        slow(long, 3),
        (one_sided, 2),
        slow(one_sided, 3),
    ],
)
def test_an_own_foundation_gives_what_the_same_shape_of_the_package_gives(
    make: Callable[[int], tuple[Distance, dict[str, Any]]],
    dim: int,
    monkeypatch: pytest.MonkeyPatch,
    comm: MPI.Intracomm,
) -> None:
    own, given = make(dim)
    expected = on(given, dim, comm)
    monkeypatch.setattr(Foundation, "shape", property(lambda given: own))
    found = on(given, dim, comm)
    assert expected.converged and found.converged, found.summary["reason"]
    assert expected.summary["contact_area"] > 0.0
    for key in ("compliance", "elastic_energy", "strain_norm_max", "contact_area"):
        assert found.summary[key] == pytest.approx(expected.summary[key], rel=1e-8), key
    for key in ("contact_force", "friction_force"):
        assert found.summary[key] == pytest.approx(expected.summary[key], rel=1e-8, abs=1e-10), key
    difference = found.displacement.x.array - expected.displacement.x.array
    assert np.abs(difference).max(initial=0.0) < 1e-9


def test_a_shape_of_a_script_is_one_without_a_key_in_study_files() -> None:
    class Floor(Shape):
        key = "floor"
        height: float = 0.0

        def gap(self, x: FloatArray) -> FloatArray:
            return x[1] - self.height

        def contact_normal(self, x: FloatArray) -> FloatArray:
            return np.stack([0.0 * x[0], 0.0 * x[0] - 1.0])

    placed = Contact("bottom", Floor(-1.0)).foundation
    assert placed is not None and isinstance(placed.shape, Floor)
    assert from_mapping({"contact": {"foundation": {"sphere": {"centre": [0, -1], "radius": 1}}}})
    with pytest.raises(InputError, match="unknown key"):
        from_mapping({"contact": {"foundation": {"floor": {"height": 0}}}})
