"""The algebra of Lorentz cones, beside its definitions written out cone by cone."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lorentz import inside, product, scaled, unit
from scipy.sparse import csc_matrix

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.cones import Balls, Cone, HalfLines, Step
from contact_locking.solver.interior_point.lorentz import Scaling
from contact_locking.solver.interior_point.slips import Slips

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
    # The second-order term is that of a step.
    both = scaled(scaling, case.dx, -1), scaled(scaling, case.dz, 1)
    assert_close(scaling.correction(case.dx, case.dz), product(*both))


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


def _with(cones: Cone, **data: Any) -> Any:
    cones.__dict__.update(data)
    return cones


@pytest.mark.parametrize("place", [0, 130, 199])
def test_a_direction_that_is_no_number_allows_no_step(place: int) -> None:
    x = np.repeat([[1.0], [0.0]], 200, axis=1)
    still, broken = np.zeros((2, 200)), np.zeros((2, 200))
    broken[1, place] = math.nan
    cones = _with(Balls(), compliance=0.0, limit=x[0], x=x, z=x.copy(), seen=x[1:])
    cones.linearise()
    steps = Step(still, still), Step(still, broken), Step(broken, still)
    assert [cones.longest_step(step) for step in steps] == [math.inf, 0.0, 0.0]


@pytest.mark.parametrize("seed", range(4))
def test_cones_alone_find_the_minimiser_of_a_conic_solver(seed: int) -> None:
    """``|u|^2/2 - f . u + sum G |S u|`` under ``B u <= g`` and ``|C u| <= M``."""
    clarabel, random, k, n = pytest.importorskip("clarabel"), np.random.default_rng(seed), 5, 12
    B, C, S = (random.standard_normal((m, k, n)) for m in (1, 3, 2))
    f, g, M, G = 3.0 * random.standard_normal(n), *random.random((3, k))
    planes, still = np.repeat([[0.0], [1.0]], [2, 1], axis=0) + np.zeros(k), np.zeros(k)
    every: list[tuple[Any, FloatArray]] = [
        (_with(HalfLines(), limit=g, compliance=0.0), B[0]),
        (_with(Balls(), limit=M, compliance=0.0), C),
        (
            _with(Slips(), normal=planes, regularisation=0.0, growth=still),
            np.pad(S, ((0, 1), (0, 0), (0, 0))),
        ),
    ]
    u = np.zeros(n)
    for cones, matrix in every:
        cones.weights, cones.seen = np.ones(k), matrix @ u
        cones.start(1.0, 1.0)
    every[2][0].set_bound(G)
    for _ in range(22):
        tangent, right = np.eye(n), f - u
        mean = sum(cones.total() for cones, _ in every) / (3.0 * k)
        for cones, matrix in every:
            cones.linearise()
            flat = matrix.reshape(-1, n)
            blocks = [cones.block(matrix[..., i]).reshape(-1) for i in range(n)]
            tangent += flat.T @ np.transpose(blocks)
            right -= flat.T @ cones.aim(0.2 * mean).reshape(-1)
        du = np.linalg.solve(tangent, right)
        steps = [cones.step(matrix @ du) for cones, matrix in every]
        t = min(1.0, *(0.9 * c.longest_step(s) for (c, _), s in zip(every, steps, strict=True)))
        u += t * du
        for (cones, matrix), step in zip(every, steps, strict=True):
            cones.advance(t, step)
            cones.seen = matrix @ u
    # The conic solver has the bounds of |S u| as unknowns behind u.
    tops = np.pad(np.eye(k), ((0, 0), (n, 0)))
    rows = [np.pad(B[0], ((0, 0), (0, k)))]
    for i in range(k):
        rows += [
            np.pad(-C[:, i], ((1, 0), (0, k))),
            -tops[i : i + 1],
            np.pad(-S[:, i], ((0, 0), (0, k))),
        ]
    right = np.concatenate([g, *(np.append(limit, np.zeros(6)) for limit in M)])
    kinds = [clarabel.SecondOrderConeT(size) for _ in range(k) for size in (4, 3)]
    options = clarabel.DefaultSettings()
    options.verbose, options.tol_gap_abs, options.tol_gap_rel = False, 1e-12, 1e-12
    P, A = (csc_matrix(x) for x in (np.diag(np.append(np.ones(n), still)), np.vstack(rows)))
    kinds.insert(0, clarabel.NonnegativeConeT(k))
    solver = clarabel.DefaultSolver(P, np.append(-f, G), A, right, kinds, options)
    assert u == pytest.approx(np.array(solver.solve().x[:n]), abs=1e-6)
