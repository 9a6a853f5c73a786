"""The contacts of a study file: foundations, motions, forces and friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import AXES, FloatArray
from contact_locking.contact.contact import Contact, FoundationSpring
from contact_locking.contact.coulomb import Convolution, Coulomb, Helmholtz, Kernel, Local
from contact_locking.contact.foundation import GivenGap, RigidFoundation
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import InputError, NotConverged, with_key
from contact_locking.fields.clock import Clock
from contact_locking.fields.sampling import Entities, features
from contact_locking.fields.values import PresentValue
from contact_locking.laws.faceted import Polyline, TriangulatedSurface
from contact_locking.laws.foundation import Cylinder, Foundation, HalfSpace, LevelSet, Sphere
from contact_locking.laws.friction import FrictionLaw
from contact_locking.laws.rigid_motion import RigidMotion, rotation
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file.tool_surface import read_corners, read_surface
from contact_locking.parallel import agree, maximum, on_root
from contact_locking.study_file.parameters import rigid_body
from contact_locking.study_file.parameters.contact_sections import ContactParameters
from contact_locking.values.value import Value, vector_at


@dataclass(frozen=True)
class Placement:
    """The surroundings of a foundation: dimension, ranks, clock, and its key in the study file."""

    dim: int
    comm: MPI.Intracomm
    clock: Clock
    key: str


#: A foundation, and warnings about its shape.
Built: TypeAlias = tuple[Foundation, Sequence[str]]


def _half_space(given: rigid_body.HalfSpace, placement: Placement) -> Built:
    return HalfSpace(given.point, given.normal), ()


def _sphere(given: rigid_body.Sphere, placement: Placement) -> Built:
    return Sphere(given.centre, given.radius), ()


def _cylinder(given: rigid_body.Cylinder, placement: Placement) -> Built:
    if placement.dim == 2:
        return Sphere(given.centre, given.radius), ()
    return Cylinder(given.centre, given.radius, given.axis or (0.0, 1.0, 0.0)), ()


def _level_set(given: Value, placement: Placement) -> Built:
    return LevelSet(lambda x: given.with_gradient(x, placement.clock.now)), ()


def _polyline(given: tuple[tuple[float, ...], ...] | str, placement: Placement) -> Built:
    if isinstance(given, str):
        file = Path(given)
        corners = on_root(placement.comm, lambda: read_corners(file, rigid_body.MOST_CORNERS))
    else:
        corners = np.array(given, dtype=float)
    kept = np.append(True, np.any(np.diff(corners, axis=0) != 0.0, axis=1))
    if kept.sum() < 2:
        raise InputError("has no segment: give at least two corners at different places")
    line = Polyline(corners[kept])
    if (crossing := line.crossing()) is not None:
        first, second = crossing
        raise InputError(
            f"crosses or touches itself: segments {first + 1} and {second + 1} meet, so that it "
            "has no two sides"
        )
    return line, () if kept.all() else (f"{(~kept).sum()} corners stand twice in a row",)


def _surface(given: rigid_body.Surface, placement: Placement) -> Built:
    shift = given.shift or (0.0, 0.0, 0.0)
    found = on_root(
        placement.comm,
        lambda: read_surface(Path(given.file), given.scale, shift, given.turned, given.spacing),
    )
    return TriangulatedSurface(found.points, found.triangles), found.warnings


#: For each shape of a section ``foundation``: the foundation of its section or value.
FOUNDATIONS: dict[str, Callable[[Any, Placement], Built]] = {
    "half_space": _half_space,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "expression": _level_set,
    "polyline": _polyline,
    "surface": _surface,
}


def build(shape: str, given: Any, placement: Placement) -> tuple[Foundation, list[str]]:
    """The foundation of a shape, and warnings; collective.  Raises InputError with its key."""
    key = f"{placement.key}.{shape}"
    try:
        foundation, warnings = FOUNDATIONS[shape](given, placement)
    except InputError as error:
        # A file may be read as that of a mesh, so that its key is replaced.
        raise InputError(str(error), key) from error
    return foundation, [f"{key}: {text}" for text in warnings]


# A negative friction coefficient smaller than this share of the largest value is zero with
# rounding.
_COEFFICIENT_ROUNDING = 1e-12
# A slip, as a share of the size of the body.
_SOME_SLIP = 1e-3
# A force below this share of the largest force is zero with rounding, as in sin(pi*t) at t = 1.
_ROUNDING = 1e-12
# The share of the largest force by which the force may leave its line.
_STRAIGHT = 1e-9


def contact_of(
    domain: Domain, given: ContactParameters, clock: Clock, times: Sequence[float]
) -> Contact:
    """The contact that a section of the study file describes; collective.

    ``times`` are those of the study.  Raises InputError for a shape that is none, and for a force
    that is zero at all times or changes its direction.
    """
    coefficient: float | FrictionLaw = 0.0
    if given.friction.coefficient != 0:
        coefficient = _friction_law(domain, given, clock)
    friction = Coulomb(coefficient, _kernel(domain, given), given.friction.regularisation)
    body, against = given.foundation, given.against or None
    found = partial(Contact, given.on, friction=friction, key=given.key, name=given.name)
    if body is None:
        return found(GapOfStudy(domain, given, clock), against=against, pair=given.pair)
    force = None
    if body.force is not None:
        force = TimedForce(body, f"{given.key}.foundation.force", clock, times)
    return found(
        _foundation(domain, given, body, clock),
        force=force,
        spring=None if body.spring is None else FoundationSpring(**dict(body.spring)),
    )


def friction_warnings(domain: Domain, given: ContactParameters, clock: Clock) -> list[str]:
    """Features of the friction coefficient between the nodes; collective.  Raises for a pole."""
    key = given.friction_key("coefficient")
    mu = given.friction.coefficient
    facets = Entities.of(domain, domain.dim - 1, domain.facets(given.on))
    # Friction may begin with the slip; from the size of the body on the slip is as good as endless.
    slips = [0.0, _SOME_SLIP * domain.extent, domain.extent]
    for slip in slips if _depends_on_slip(mu) else slips[:1]:
        if found := features(facets, mu, key, "refine the mesh there", s=slip):
            return found
    return []


class GapOfStudy(GivenGap):
    """A number or an expression of x, y[, z] and t along the outward normal of the body."""

    def __init__(self, domain: Domain, given: ContactParameters, clock: Clock) -> None:
        key = f"{given.key}.gap"
        self._field, self._clock = PresentValue(domain.comm, given.gap, key, clock), clock
        self.is_timed = given.gap.is_timed
        super().__init__(domain.comm, domain.dim, self._field, key)

    def warnings(self, surface: ContactSurface, gap: FloatArray) -> list[str]:
        domain = surface.domain
        facets = Entities.of(domain, domain.dim - 1, surface.facets)
        advice, times = "refine the mesh there", self._clock.some_times
        return features(facets, self._field.value, self._key, advice, "range", times)


def _foundation(
    domain: Domain, contact: ContactParameters, given: rigid_body.Foundation, clock: Clock
) -> RigidFoundation:
    """The foundation of a section; collective."""
    key, dim = f"{contact.key}.foundation", domain.dim
    placement = Placement(dim, domain.comm, clock, key)
    shape, value = given.shape
    body, warnings = build(shape, value, placement)
    timed_shape = given.expression is not None and given.expression.is_timed
    motion = partial(_motion, given, f"{key}.motion", dim, clock)
    is_moved = given.moved is not None or timed_shape
    return RigidFoundation(domain.comm, dim, body, motion, key, is_moved, shape, warnings)


def _motion(given: rigid_body.Foundation, key: str, dim: int, clock: Clock) -> RigidMotion:
    moved = given.moved
    if moved is None:
        return RigidMotion.rest(dim)
    now, zero = clock.now, (Value.of(0.0),) * dim
    angles = moved.angles or zero[:1] * (1 if dim == 2 else 3)
    return RigidMotion(
        with_key(f"{key}.translation", lambda: vector_at(moved.translation or zero, now)),
        rotation(with_key(f"{key}.rotation", lambda: vector_at(angles, now))),
        np.array(moved.about or (0.0,) * dim, dtype=float),
    )


class TimedForce:
    """The force ``F(t) d`` of a section, along one line with the unit vector d."""

    def __init__(
        self, given: rigid_body.Foundation, key: str, clock: Clock, times: Sequence[float]
    ) -> None:
        # Motion along a spring moves its far end.
        moved = None if given.spring is not None else given.moved
        translation = () if moved is None else moved.translation or ()
        self.key, self._clock = key, clock
        self._force, self._translation = given.force or (), translation
        forces = np.array([self._vector(self._force, time) for time in times])
        sizes = np.linalg.norm(forces, axis=1)
        self.largest = float(sizes.max())
        if self.largest == 0.0:
            raise InputError(
                "is zero at all times, so that nothing pushes the foundation; leave it out for a "
                "foundation that stands still",
                self.key,
            )
        first = int(np.argmax(sizes > _ROUNDING * self.largest))
        self.direction: FloatArray = forces[first] / sizes[first]
        for time in times:
            self._size(time)

    def size(self) -> float:
        """F at present.  Raises InputError for a force that leaves its direction."""
        return self._size(self._clock.now)

    def _vector(self, components: Sequence[Value], time: float) -> FloatArray:
        return with_key(self.key, lambda: vector_at(components, time))

    def _size(self, time: float) -> float:
        force = self._vector(self._force, time)
        size = float(force @ self.direction)
        at = f" at t = {time:g}" if any(value.is_timed for value in self._force) else ""
        if np.linalg.norm(force - size * self.direction) > _STRAIGHT * self.largest:
            raise InputError(
                f"has another direction{at} than at first, and a foundation moves along one line; "
                "keep the ratio of the components",
                self.key,
            )
        if size < -_ROUNDING * self.largest:
            raise InputError(
                f"is turned round{at}: a foundation pushes and cannot pull, and nothing would stop "
                "the foundation; a force of 0 lets the body go",
                self.key,
            )
        if self._translation:
            moved = self._vector(self._translation, time)
            if abs(moved @ self.direction) > _STRAIGHT * np.linalg.norm(moved):
                raise InputError(
                    f"is along foundation.motion at t = {time:g}: the force decides how far the "
                    "foundation moves along it; leave out this component of the motion",
                    self.key,
                )
        return size if size > _ROUNDING * self.largest else 0.0


def _depends_on_slip(mu: Value) -> bool:
    return mu.expression is not None and "s" in mu.expression.names


def _kernel(domain: Domain, part: ContactParameters) -> Kernel:
    given = part.friction.smoothing
    if given.kernel == "none":
        return Local()
    # A refined mesh keeps the default radius of the first mesh.
    radius = given.radius or domain.smoothing_radii.get(part.key)
    kind = Convolution if given.kernel == "convolution" else Helmholtz
    return kind(radius, part.friction_key("smoothing.radius"))


def _friction_law(domain: Domain, part: ContactParameters, clock: Clock) -> FrictionLaw:
    """``mu(x, s)`` from a number or an expression; every evaluation is collective."""
    comm, key = domain.comm, part.friction_key("coefficient")
    value = part.friction.coefficient

    def local(points: FloatArray, slip: FloatArray) -> FloatArray:
        try:
            return value.at(points.T, s=slip)
        except InputError as error:
            # An iterate may slip farther than the solution, beyond the end of a table.
            if slip.any():
                raise NotConverged(f"{key}: {error}") from error
            raise InputError(str(error), key) from error

    def whole(points: FloatArray, slip: FloatArray) -> FloatArray:
        mu = agree(comm, lambda: local(points, slip))
        # An expression that is zero may evaluate to less than zero by rounding.
        least = -_COEFFICIENT_ROUNDING * maximum(comm, np.abs(mu))
        agree(comm, lambda: _refuse_negative(mu, least, points, slip, key))
        return np.maximum(mu, 0.0)

    return FrictionLaw(
        whole,
        largest=value.number,
        lipschitz=None if _depends_on_slip(value) else 0.0,
    )


def _refuse_negative(
    mu: FloatArray, least: float, points: FloatArray, slip: FloatArray, key: str
) -> None:
    """Raise InputError, with the point, if a friction coefficient is below ``least``."""
    if not np.any(mu < least):
        return
    worst = int(np.argmin(mu))
    where = [f"{axis} = {place:.6g}" for axis, place in zip(AXES, points[worst], strict=False)]
    raise InputError(
        f"the friction coefficient must not be negative, it is {mu[worst]:g} at "
        f"{', '.join(where)}, s = {slip[worst]:.6g}",
        key,
    )
