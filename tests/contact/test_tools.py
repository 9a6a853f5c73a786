"""Tools: rigid foundations that move, and the friction by which they drag the body."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import all_of, block
from slow import slow

from contact_locking import Contact, Foundation, InputError, Parameters, from_mapping, solve
from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum
from contact_locking.results.contact_points import SLIP, STICK
from contact_locking.results.solution import StudySolution
from contact_locking.shapes.shape import Distance, Shape

WAY = ["0.02*sin(6*t)", "0.02*min(4*t, 1)"]


def pressed(dim: int, n: float, top: list[Any], motion: Any, **changes: Any) -> Parameters:
    """A block held at its top, and a half space below."""
    point, normal = [0.0] * dim, [*[0.0] * (dim - 1), 1.0]
    foundation: dict[str, Any] = {"half_space": {"point": point, "normal": normal}}
    if motion is not None:
        foundation["motion"] = motion
    given: dict[str, Any] = {
        "h": 0.25 if dim == 2 else 0.5,
        "loads": {"displacements": [{"on": "top", "value": top}]},
        "contact": {"on": "bottom", "foundation": foundation},
        "steps": {"times": [0.25, 0.4, 0.75]},
        "material__locking_limit": 0.04,
        "friction__coefficient": 0.2,
        "penalty__n": n,
        "solver__tolerance": 1e-11,
        "solver__friction_tolerance": 1e-11,
    }
    return block(dim, **(given | changes))


def in_space(way: list[str], dim: int) -> list[str]:
    return way if dim == 2 else [way[0], "0.01*t", way[1]]


@pytest.mark.parametrize(("dim", "n"), [(2, 1e3), (2, math.inf), slow(3, math.inf)])
def test_a_tool_that_moves_is_a_body_that_moves_the_other_way(dim: int, n: float) -> None:
    way = in_space(WAY, dim)
    moved = all_of(pressed(dim, n, [0.0] * dim, way))
    fixed = all_of(pressed(dim, n, [f"-({value})" for value in way], None))
    states: set[int] = set()
    for a, b in zip(moved, fixed, strict=True):
        t = a.time
        by = [0.02 * math.sin(6 * t), *[0.01 * t] * (dim - 2), 0.02 * min(4 * t, 1)]
        u, w = (found.displacement.x.array.reshape(-1, dim) for found in (a, b))
        assert np.abs(u - by - w).max(initial=0.0) < 1e-9
        one, other = a.contacts[0], b.contacts[0]
        for name in ("pressure", "traction", "bound", "slip", "increment"):
            x, y = getattr(one, name), getattr(other, name)
            assert np.abs(x - y).max(initial=0.0) < 1e-9, name
        assert np.array_equal(one.state, other.state)
        states |= set(MPI.COMM_WORLD.allreduce(one.state.tolist()))
        for name in ("elastic_energy", "contact_force", "friction_force"):
            assert a.summary[name] == pytest.approx(b.summary[name], abs=1e-9)
        # The work differs only by the force with which the support moved or did not.
        for name in ("stored", "dissipated"):
            x, y = (found.history.last(name) for found in (a, b))
            assert x == pytest.approx(y, abs=1e-10)
        assert a.summary["certificate"]["criteria"]["energy_balance"]["holds"]
    assert {SLIP, STICK} <= states


@pytest.mark.serial
@pytest.mark.parametrize("n", [slow(1e3), math.inf])
@pytest.mark.parametrize(
    "motion",
    [
        ["0.3*t", "0.03*min(3*t, 1)"],
        {"translation": [0, 0.03], "rotation": "0.1*sin(5*t)", "about": [0.4, -1.0]},
    ],
    ids=["slides", "rolls"],
)
def test_no_tool_creates_energy_whatever_its_normals_do(n: float, motion: Any) -> None:
    disc = {"sphere": {"centre": [0.4, -1.0], "radius": 1.0}, "motion": motion}
    found = all_of(
        pressed(
            2,
            n,
            [0.0, 0.0],
            None,
            h=0.125,
            contact={"on": "bottom", "foundation": disc},
            steps={"to": 0.8, "count": 4},
            material__locking_limit=0.08,
        )
    )
    for before, after in itertools.pairwise(found):
        assert after.history.last("numerical") >= -1e-12
        assert after.history.last("energy_defect") < 1e-8
        turned = np.abs(after.contacts[0].normal - before.contacts[0].normal).max(initial=0.0)
        assert (maximum(MPI.COMM_WORLD, turned) > 1e-3) == isinstance(motion, list)
    assert found[-1].history.last("dissipated_total") > 0.0


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


def on(foundation: dict[str, Any], dim: int, comm: MPI.Intracomm) -> StudySolution:
    h = 0.2 if dim == 2 else 0.5
    return solve(block(dim, h, contact={"on": "bottom", "foundation": foundation}), comm)


def round_end(dim: int) -> tuple[Distance, dict[str, Any]]:
    """A capsule without a length is a sphere."""
    centre = (*[0.4] * (dim - 1), -3.0)
    return Capsule(centre, centre, 2.995), {"sphere": {"centre": list(centre), "radius": 2.995}}


def long(dim: int) -> tuple[Distance, dict[str, Any]]:
    """A capsule that is longer than the body is a cylinder."""
    cylinder = {"cylinder": {"centre": [0.4, 0.0, -3.0], "radius": 2.995, "axis": [0.0, 1.0, 0.0]}}
    return Capsule((0.4, -1.0, -3.0), (0.4, 2.0, -3.0), 2.995), cylinder


@pytest.mark.serial
@pytest.mark.parametrize(
    ("make", "dim"),
    [
        (round_end, 2),
        slow(round_end, 3),
        slow(long, 3),
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


@pytest.mark.serial
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
