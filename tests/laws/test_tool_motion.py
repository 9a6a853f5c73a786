"""The motions of tools: rotations, distances of what has moved, and what a study file may say."""

from __future__ import annotations

import numpy as np
import pytest

from contact_locking.arrays import FloatArray
from contact_locking.laws.rigid_motion import RigidMotion, rotation
from contact_locking.shapes.analytic import HalfSpace, Sphere
from contact_locking.shapes.shape import MovedDistance

pytestmark = pytest.mark.serial


@pytest.mark.parametrize("angles", [[0.7], [0.3, -0.2, 0.5], [0.0, 0.0, 0.0]])
def test_a_rotation_is_the_exponential_of_its_vector(angles: list[float]) -> None:
    from scipy.linalg import expm

    x, y, z = angles if len(angles) == 3 else (0.0, 0.0, angles[0])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    size = 2 if len(angles) == 1 else 3
    assert rotation(np.array(angles)) == pytest.approx(expm(cross)[:size, :size], abs=1e-14)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_moved_body_has_the_distance_of_the_body_where_it_was(dim: int) -> None:
    random = np.random.default_rng(3)

    def vector() -> FloatArray:
        return random.normal(size=dim)

    motion = RigidMotion(vector(), rotation(random.normal(size=1 if dim == 2 else 3)), vector())
    x = random.normal(size=(dim, 20))
    assert motion.place(motion.origin(x)) == pytest.approx(x)
    centre = vector()
    ball = MovedDistance(Sphere(tuple(centre), 0.3), motion)
    there = Sphere(tuple(motion.place(centre[:, None])[:, 0]), 0.3)
    assert ball.gap(x) == pytest.approx(there.gap(x))
    assert ball.contact_normal(x) == pytest.approx(there.contact_normal(x))
    plane = MovedDistance(HalfSpace(tuple(vector()), tuple(vector())), motion)
    step = 1e-6 * np.array([vector()]).T
    slope = plane.gap(x + step) - plane.gap(x)
    assert slope == pytest.approx(-np.sum(plane.contact_normal(x) * step, axis=0), abs=1e-13)
