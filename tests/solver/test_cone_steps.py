"""The steps of each family of cones satisfy the linearised equations that they come from."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from lorentz import inside, product, scaled, unit
from mpi4py import MPI

from contact_locking.solver.interior_point.contact_cones import ContactCones
from contact_locking.solver.interior_point.family import Step
from contact_locking.solver.interior_point.friction_cones import FrictionCones
from contact_locking.solver.interior_point.locking_cones import LockingCones, StrainHalfLines
from contact_locking.solver.interior_point.lorentz import Scaling

pytestmark = pytest.mark.serial


def _points(**given: Any) -> Any:
    """Points with weights, which is all that the algebra of a family of cones takes."""
    return SimpleNamespace(comm=MPI.COMM_SELF, **given)


@pytest.mark.parametrize("compliance", [0.0, 0.3])
def test_eliminated_steps_satisfy_the_full_newton_system(compliance: float) -> None:
    random = np.random.default_rng(3)
    eps = 0.3 * random.standard_normal((3, 6))
    points = _points(weights=np.ones(6), rows=3, limit=np.full(6, 1.0))
    locking = LockingCones(points, compliance, 0)
    locking.seen = eps
    locking.start(0.0, 0.0)
    locking.x[0] += 0.3
    locking.z = inside(random, 4, 6)
    locking.seen = eps + 0.01
    locking.linearise()
    resting = locking.aim(0.2)
    d_eps = random.standard_normal((3, 6))
    step = locking.step(d_eps)
    moved = Step(locking.x + step.primal, locking.z + step.dual)
    # The multiplier's step is what the tangent block says it is ...
    tangent = locking.a * d_eps + locking.b * np.sum(locking.w * d_eps, axis=0) * locking.w
    np.testing.assert_allclose(-moved.dual[1:], resting + tangent, rtol=1e-9, atol=1e-9)
    # ... primal feasibility is restored ...
    np.testing.assert_allclose(moved.primal[0], 1.0 + compliance * moved.dual[0], atol=1e-10)
    np.testing.assert_allclose(moved.primal[1:], eps + 0.01 + d_eps, atol=1e-10)
    # ... and the linearised complementarity reaches its target.
    scaling = Scaling.of(locking.x, locking.z)
    change = scaled(scaling, step.primal, -1) + scaled(scaling, step.dual, 1)
    reached = product(scaling.point, scaling.point + change)
    np.testing.assert_allclose(reached, 0.2 * unit(4, 6), atol=1e-8)


@pytest.mark.parametrize("epsilon", [0.0, 0.2])
def test_friction_steps_leave_the_bound_alone_and_match_their_tangent(epsilon: float) -> None:
    random = np.random.default_rng(5)
    slip = random.standard_normal((2, 4))
    friction = FrictionCones(_points(weights=np.ones(4), dim=2), epsilon, 1.0)
    friction.seen = slip
    friction.start(0.0, 0.5)
    friction.set_bound(np.full(4, 2.0))
    friction.z[1:] = 0.3 * random.standard_normal(friction.z[1:].shape)
    friction.linearise()
    resting = friction.aim(0.1)
    d_slip = random.standard_normal((2, 4))
    step = friction.step(d_slip)
    assert np.all(step.dual[0] == 0.0)
    tangent = friction.a * d_slip + friction.b * np.sum(friction.w * d_slip, axis=0) * friction.w
    moved = -(friction.z + step.dual)[1:3]
    np.testing.assert_allclose(moved, resting + tangent, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", [LockingCones, StrainHalfLines])
def test_points_on_the_central_path_tend_to_the_penalty_law(kind: type[Any]) -> None:
    seen = np.random.default_rng(4).standard_normal((3, 40))
    points = _points(weights=np.ones(40), rows=3, limit=np.full(40, 0.6))
    cones = kind(points, 0.3, 0)
    cones.seen = seen[0] if kind is StrainHalfLines else seen
    cones.settle(1e-13)
    sizes = np.linalg.norm(np.atleast_2d(cones.penalised), axis=0)
    assert 0 < np.count_nonzero(sizes) < len(sizes)
    np.testing.assert_allclose(cones.penalised, cones.reactions, atol=1e-10)


@pytest.mark.parametrize("share", [0.15, 0.75])
def test_a_share_of_a_recentring_is_that_share_of_the_way_to_its_step(share: float) -> None:
    random = np.random.default_rng(7)
    points = _points(weights=np.ones(6), rows=3, limit=np.full(6, 1.0))
    locking = LockingCones(points, 0.3, 0)
    locking.x, locking.z = inside(random, 4, 6), inside(random, 4, 6)
    locking.seen = 0.3 * random.standard_normal((3, 6))
    locking.linearise()
    correction, change = random.standard_normal((2, 4, 6))
    plain_strain, full_strain = random.standard_normal((2, 3, 6))

    def step(share: float) -> Step:
        locking.aim(0.2, correction + share * change)
        return locking.step(plain_strain + share * (full_strain - plain_strain))

    start, end = step(0.0), step(1.0)
    expected, found = step(share), start.plus(end.plus(start, -1.0), share)
    np.testing.assert_allclose(found.primal, expected.primal, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.dual, expected.dual, rtol=1e-9, atol=1e-9)


def test_contact_step_satisfies_the_linearised_complementarity() -> None:
    contact = ContactCones(_points(weights=np.ones(2), gap=np.zeros(2)), 0.1, 1.0)
    contact.seen = -np.array([0.2, 0.5])
    contact.start(0.3, 0.01)
    contact.seen = -np.array([0.1, 0.6])
    contact.linearise()
    resting = contact.aim(0.2)
    d_normal = np.array([0.05, -0.02])
    step = contact.step(d_normal)
    np.testing.assert_allclose(contact.z + step.dual, resting + contact.stiffness * d_normal)
    products = contact.x * contact.z + step.primal * contact.z + contact.x * step.dual
    np.testing.assert_allclose(products, 0.2)
