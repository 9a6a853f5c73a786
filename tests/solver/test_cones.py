"""The algebra of Lorentz cones, beside its definitions written out cone by cone."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lorentz import inside, product, scaled, unit

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.family import Step
from contact_locking.solver.interior_point.locking_cones import LockingCones
from contact_locking.solver.interior_point.lorentz import Scaling

pytestmark = pytest.mark.serial


class Case(NamedTuple):
    """Points inside their cones, and any steps."""

    x: FloatArray
    z: FloatArray
    dx: FloatArray
    dz: FloatArray


@st.composite
def cases(draw: st.DrawFn) -> Case:
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    shape = draw(st.integers(2, 7)), draw(st.sampled_from([0, 1, 5, 300]))
    steps = random.standard_normal((2, *shape))
    return Case(inside(random, *shape), inside(random, *shape), *steps)


def assert_close(a: FloatArray, b: FloatArray) -> None:
    """To ten digits of the largest: W of a point near the boundary has a large condition."""
    np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-10 * (1.0 + np.abs(b).max(initial=0.0)))


@settings(max_examples=30, deadline=None)
@given(cases())
def test_the_scaling_maps_both_points_to_the_same_one(case: Case) -> None:
    scaling = Scaling.of(case.x, case.z)
    assert_close(scaled(scaling, case.z, 1), scaling.point)
    assert_close(scaled(scaling, scaling.point, 1), case.x)


@settings(max_examples=30, deadline=None)
@given(cases(), st.sampled_from([0.0, 0.7]), st.booleans())
def test_what_is_aimed_at_is_reached(case: Case, target: float, corrects: bool) -> None:
    for point in (case.x, case.z):
        point[0] = 1.0 + np.linalg.norm(point[1:], axis=0)
    correction = case.dx if corrects else None
    scaling = Scaling.of(case.x, case.z)
    b = scaling.aim(target, correction)
    # dz = b where dx = 0: lambda o W dz = target e - lambda o lambda - correction.
    reached = product(scaling.point, scaling.point + scaled(scaling, b, 1))
    wanted = target * unit(*case.x.shape) - (0.0 if correction is None else correction)
    assert_close(reached, wanted)


@settings(max_examples=30, deadline=None)
@given(cases())
def test_the_correction_is_that_of_the_step(case: Case) -> None:
    x, z, dx, dz = case
    scaling = Scaling.of(x, z)
    expected = product(scaled(scaling, dx, -1), scaled(scaling, dz, 1))
    assert_close(scaling.correction(dx, dz), expected)


@settings(max_examples=50, deadline=None)
@given(cases(), st.sampled_from([0.0, 3.0]))
def test_the_longest_step_ends_on_the_boundary_of_a_cone(case: Case, inwards: float) -> None:
    points, steps = case[:2], np.array(case[2:])
    # The step has no limit if no point leaves its cone.
    steps[:, 0] += inwards
    speed = np.max(Scaling.of(*points).speeds(*steps), initial=0.0)
    t = 1.0 / speed if speed > 0.0 else math.inf

    def slack(t: float) -> float:
        ends = [point + t * step for point, step in zip(points, steps, strict=True)]
        least = [np.min(y[0] - np.linalg.norm(y[1:], axis=0), initial=math.inf) for y in ends]
        return float(min(least))

    if math.isinf(t):
        assert slack(1e6) > 0.0
    else:
        assert slack(t) == pytest.approx(0.0, abs=1e-7 * (1.0 + t * np.abs(steps).max()))
        assert slack(0.99 * t) > 0.0


@pytest.mark.parametrize("place", [0, 130, 199])
def test_a_direction_that_is_no_number_allows_no_step(place: int) -> None:
    x = np.repeat([[1.0], [0.0]], 200, axis=1)
    still, broken = np.zeros((2, 200)), np.zeros((2, 200))
    broken[1, place] = math.nan
    points: Any = SimpleNamespace(comm=None, weights=None, limit=x[0], rows=1)
    cones = LockingCones(points, 0.0, 0)
    cones.x, cones.z, cones.seen = x, x.copy(), x[1:]
    cones.linearise()
    steps = Step(still, still), Step(still, broken), Step(broken, still)
    assert [cones.longest_step(step) for step in steps] == [math.inf, 0.0, 0.0]
