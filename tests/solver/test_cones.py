"""The cones alone: their scaling beside its definition, and a problem beside a conic solver."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_matrix

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.balls import Balls
from contact_locking.solver.interior_point.cones import Cone, Step
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.lorentz import Scaling
from contact_locking.solver.interior_point.slips import Slips, SmoothSlipPieces, along_planes

pytestmark = pytest.mark.serial

_SHAPES = [(size, count) for size in (2, 3, 4, 7) for count in (0, 1, 300)]


def _points_and_steps(size: int, count: int) -> tuple[FloatArray, FloatArray]:
    """Two points (2, m, k) inside their cones, and any two steps."""
    random = np.random.default_rng(size * (count + 1))
    points, steps = random.standard_normal((2, 2, size, count))
    points[:, 0] = np.linalg.norm(points[:, 1:], axis=1) + random.uniform(1e-6, 2.0, (2, count))
    return points, steps


def _product(x: FloatArray, z: FloatArray) -> FloatArray:
    """``x o z``."""
    return np.vstack([np.sum(x * z, axis=0), x[0] * z[1:] + z[0] * x[1:]])


def _scaled(scaling: Scaling, y: FloatArray, power: int) -> FloatArray:
    """``W y`` or ``W^-1 y`` (power -1), with W as a matrix for each cone."""
    J, v = np.diag([1.0] + [-1.0] * (len(y) - 1)), scaling.w.copy()
    v[0] += 1.0
    v /= np.sqrt(2.0 * v[0])
    W = scaling.eta[:, None, None] * (2.0 * np.einsum("ik,jk->kij", v, v) - J)
    return np.einsum("kij,jk->ik", W if power == 1 else np.linalg.inv(W), y)


def _assert_close(a: FloatArray, b: FloatArray) -> None:
    """To ten digits of the largest: W of a point near the boundary has a large condition."""
    np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-10 * (1.0 + np.abs(b).max(initial=0.0)))


@pytest.mark.parametrize("shape", _SHAPES)
@pytest.mark.parametrize("corrects", [0.0, 1.0])
def test_what_is_aimed_at_is_reached(shape: tuple[int, int], corrects: float) -> None:
    points, (dx, dz) = _points_and_steps(*shape)
    points[:, 0] = 1.0 + np.linalg.norm(points[:, 1:], axis=1)
    scaling = Scaling.of(*points)
    # dz = b where dx = 0: lambda o W dz = target e - lambda o lambda - correction.
    moved = _scaled(scaling, scaling.aim(0.7, corrects * dx), 1)
    wanted = 0.7 * np.eye(shape[0])[:, [0] * shape[1]] - corrects * dx
    _assert_close(_product(scaling.point, scaling.point + moved), wanted)
    # The second-order term is that of a step.
    wanted = _product(_scaled(scaling, dx, -1), _scaled(scaling, dz, 1))
    _assert_close(scaling.correction(dx, dz), wanted)


@pytest.mark.parametrize("shape", _SHAPES)
@pytest.mark.parametrize("inwards", [0.0, 3.0])
def test_the_longest_step_ends_on_a_boundary(shape: tuple[int, int], inwards: float) -> None:
    points, steps = _points_and_steps(*shape)
    # The step has no limit if no point leaves its cone.
    steps[:, 0] += inwards
    speed = np.max(Scaling.of(*points).speeds(*steps), initial=0.0)
    t = 1.0 / speed if speed > 0.0 else math.inf

    def slack(t: float) -> float:
        ends = points + t * steps
        return float(np.min(ends[:, 0] - np.linalg.norm(ends[:, 1:], axis=1), initial=math.inf))

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
    B, C, S = (random.standard_normal((m, k, n)) for m in (1, 3, 3))
    S[2] = 0.0
    f, g, M, G = 3.0 * random.standard_normal(n), *random.random((3, k))
    planes, still = np.repeat([[0.0], [1.0]], [2, 1], axis=0) + np.zeros(k), np.zeros(k)
    every: list[tuple[Any, FloatArray]] = [
        (_with(HalfLines(), limit=g, compliance=0.0), B[0]),
        (_with(Balls(), limit=M, compliance=0.0), C),
        (_with(Slips(), normal=planes, regularisation=0.0, growth=still), S),
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
    rows = [np.pad(B[0], ((0, 0), (0, k)))]
    for i in range(k):
        vectors = np.pad(np.stack([C[:, i], S[:, i]]), ((0, 0), (1, 0), (0, k)))
        vectors[1, 0, n + i] = 1.0
        rows += list(-vectors)
    right = np.concatenate([g, *(np.append(limit, np.zeros(7)) for limit in M)])
    kinds = [clarabel.NonnegativeConeT(k), *[clarabel.SecondOrderConeT(4)] * (2 * k)]
    options = clarabel.DefaultSettings()
    options.verbose, options.tol_gap_abs, options.tol_gap_rel = False, 1e-12, 1e-12
    P, A = (csc_matrix(x) for x in (np.diag(np.append(np.ones(n), still)), np.vstack(rows)))
    solver = clarabel.DefaultSolver(P, np.append(-f, G), A, right, kinds, options)
    assert u == pytest.approx(np.array(solver.solve().x[:n]), abs=1e-6)


def _friction(length: float, random: np.random.Generator) -> tuple[SmoothSlipPieces, Slips]:
    """A smooth law of friction at points with planes across the first axis of space."""
    count = 40
    family = Slips()
    family.normal = np.repeat(np.eye(3)[:, :1], count, axis=1)
    family.weights, family.regularisation = np.ones(count), length
    family.x, family.z = np.zeros((2, 5, count))
    family.z[0] = random.uniform(0.1, 2.0, count)
    law = family.pieces(1.7, 1e14)
    assert isinstance(law, SmoothSlipPieces)
    family.seen = along_planes(random.standard_normal((3, count)), family.normal)
    return law, family


@pytest.mark.parametrize("length", [1e-6, 1e-2, 1.0])
def test_smooth_friction_has_one_slip_for_each_shift_and_its_derivative(length: float) -> None:
    """``y = G s/sqrt(s^2 + eps^2)`` at the solution, and the step that the law's slope gives."""
    random = np.random.default_rng(5)
    law, family = _friction(length, random)
    slip = family.seen * random.uniform(0.0, 3.0, 40) * length
    reach = np.sqrt(np.sum(slip**2, axis=0) + length**2)
    family.seen = slip
    law.start(family.bound / reach * slip)
    assert law._law() == pytest.approx(law.y, rel=1e-9, abs=1e-12)
    law.linearise()
    law.evaluate()
    assert np.abs(law.rest).max() <= 1e-8 * np.abs(law.y).max() * (1.0 + 1.0 / length)
    step = along_planes(random.standard_normal((3, 40)), family.normal) * length
    t = 1e-6
    moved = [slip + sign * t * step for sign in (1.0, -1.0)]
    ends = [family.bound * s / np.sqrt(np.sum(s**2, axis=0) + length**2) for s in moved]
    slope = (ends[0] - ends[1]) / (2.0 * t)
    assert family.block(step) == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(slope).max())
    # The reaction at the same slip is in proportion to the bound.
    assert family.response(family.bound) == pytest.approx(law.y, rel=1e-6, abs=1e-9)
