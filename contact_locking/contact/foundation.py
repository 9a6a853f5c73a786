"""A foundation on the mesh: a gap, or a shape that may move."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.contact import Foundation
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import InputError, Misplaced, with_key
from contact_locking.fem.fields import Clock, Entities, PresentValue, features
from contact_locking.findings import Finding
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, maximum, on_any_rank, on_every_rank
from contact_locking.shapes.analytic import LevelSetAt
from contact_locking.shapes.faceted import FacetedFoundation
from contact_locking.shapes.shape import Distance, MovedDistance, OwnShape, RigidMotion, Shape
from contact_locking.values.value import Value

_TOO_FAR = "its distance is not a finite number: the foundation is too far away or too large"
_NO_GRADIENT = (
    "its distance is not a finite number somewhere on Gamma_C: there its gradient vanishes or is "
    "infinite, and no direction leads to the foundation"
)
_BEHIND = (
    "the foundation lies behind {on}, where the outward normals of the body point away from the "
    "foundation; name a boundary part that faces the foundation"
)
_TOO_DEEP = (
    "the foundation lies behind a part of Gamma_C, which is inside of it while the outward normal "
    "of the body points away from it; let the foundation reach less deep into the body"
)
_INSIDE = (
    "a part of Gamma_C lies inside the foundation, and the nearest surface of the foundation is "
    "across the body; either the foundation is inside out, or it reaches too deep into the body"
)
_TOO_FAR_IN = (
    "a part of Gamma_C lies inside the foundation, by more than the width of the body along its "
    "normal; let the foundation reach less deep into the body"
)
# The nearest side of a foundation does not count if its normal has a smaller component along that
# of the body: it is the side of an edge, or lies behind the body.
_SIDEWAYS = 0.2
# Normals of foundation and body are orthogonal where their product is smaller.
_ALONG = 1e-9
# A gradient that is shorter, or longer than the inverse, is not that of a distance.
_LEAST_SLOPE = 0.8
# The normals of a user's foundation have the length 1 up to this tolerance.
_UNIT = 1e-6
# A gradient that is shorter than this share of the longest one is zero with rounding.
_ROUNDING = 1e-10
# A foundation that is longer or shorter than the body by this factor probably has other units.
_LARGE_RATIO = 200.0
# Distances below this share of the coordinates are rounding.
_TOUCH = 8.0 * float(np.finfo(float).eps)


class PlacedFoundation:
    """The foundation of one contact, at its present place: here a gap along the outward normal.

    The gap adds to the distance to another body, and is unknown at points off Gamma_C.  All methods
    are collective.

    - ``is_timed``: gap or normal may change from solve to solve
    - ``moves``: the foundation has a motion, which drags the body by friction
    - ``is_distance``: its distance is exact everywhere, and changes by no more than a point moves
    - ``is_plane``, ``has_shape``: it is a half space, it is a rigid body
    """

    moves = is_distance = is_plane = has_shape = False

    def __init__(self, domain: Domain, value: Value, key: str, clock: Clock) -> None:
        self._comm, self._dim, self._key, self._clock = domain.comm, domain.dim, key, clock
        self._present, self.is_timed = PresentValue(value, key, clock), value.is_timed

    def gap(self, x: FloatArray) -> FloatArray:
        """The gap (k,) at points (d, k) of Gamma_C at the present time."""
        values = self._present(x)
        if not on_every_rank(self._comm, np.isfinite(values)):
            raise InputError("is not a finite number somewhere on Gamma_C", self._key)
        return values

    def at_nodes(self, surface: ContactSurface) -> tuple[FloatArray, FloatArray]:
        """The gap (k,) and the contact normal (k, d) at the nodes at present."""
        return surface.distance + self.gap(surface.places.T), surface.body_normals

    def opening(self, x: FloatArray, u_normal: FloatArray, moved: FloatArray) -> FloatArray:
        """How far (k,) points x (d, k) of Gamma_C are away after they moved to ``moved`` (d, k).

        ``u_normal`` (k,) is the displacement along the contact normal.
        """
        return self.gap(x) - u_normal

    def distance(self, x: FloatArray) -> FloatArray:
        """The distance (k,) of any points (d, k), negative inside, inf where it is not known."""
        return np.full(x.shape[1], np.inf)

    def corners(self, box: FloatArray, spacing: float) -> FloatArray:
        """Points (c, d) at present in a box (2, d) where it may enter a flat facet first.

        These are the corners of a foundation of facets, and points of its sharp edges that are
        ``spacing`` apart.
        """
        return np.empty((0, self._dim))

    @property
    def now(self) -> Distance | None:
        """The body at its present place, None for a gap."""
        return None

    def motion(self) -> RigidMotion:
        """Where it has moved from rest."""
        return RigidMotion.rest(self._dim)

    def drag(self, surface: ContactSurface, before: RigidMotion) -> FloatArray:
        """How far (k, d) it has moved since it was at ``before``, in limited values."""
        return np.zeros_like(surface.points)

    def findings(self, surface: ContactSurface, gap: FloatArray) -> list[Finding]:
        """Findings about the present gap (k,) at the nodes; collective."""
        facets = Entities.of(surface.domain, self._dim - 1, surface.facets)
        advice, times = "refine the mesh there", self._clock.some_times
        return features(facets, self._present.value, self._key, advice, "range", times)


def _check_own(body: Distance, x: FloatArray) -> None:
    """Raise InputError for a user's own foundation without gaps and normals at points (d, k)."""
    gap: Any = body.gap(x)
    normal: Any = body.contact_normal(x)
    parts = (("gap", gap, x.shape[1:], "(k,)"), ("contact_normal", normal, x.shape, "(d, k)"))
    for name, values, shape, expected in parts:
        if not isinstance(values, np.ndarray) or values.shape != shape:
            kind = type(values).__name__
            actual = f"{kind} {values.shape}" if hasattr(values, "shape") else kind
            raise InputError(
                f"its {name} must be an array {expected} at points (d, k), here {shape}, not "
                f"{actual}"
            )
    length = np.linalg.norm(normal, axis=0)
    for name, values, is_right, expected in (
        ("gap", gap, np.isfinite(gap), "finite"),
        ("length of contact_normal", length, np.abs(length - 1.0) <= _UNIT, "1"),
    ):
        if not is_right.all():
            first = int(np.argmin(is_right))
            at = ", ".join(f"{value:.3g}" for value in x[:, first])
            raise InputError(f"its {name} must be {expected}, and is {values[first]:.3g} at ({at})")


class RigidFoundation(PlacedFoundation):
    """A foundation with a shape, at rest or with a prescribed motion from rest.

    ``key`` is that of the foundation in messages.  The constructor is collective, as it may read a
    file.  The methods raise InputError for a shape whose distance is not finite, and Misplaced for
    one that lies behind Gamma_C, or so deep in the body that its nearest surface is across the
    body.
    """

    has_shape = True

    def __init__(self, domain: Domain, foundation: Foundation, key: str, clock: Clock) -> None:
        self._comm, self._dim, self._key, self._clock = domain.comm, domain.dim, key, clock
        self._place = f"{key}.{foundation.shape_key}".removesuffix(".")
        self._moved, shape = foundation.moved, foundation.shape
        shape = shape if isinstance(shape, Shape) else OwnShape(shape)
        try:
            self._shape: Shape = shape.read(domain.comm)
        except InputError as error:
            # A file may be read as that of a mesh, so that its key is replaced.
            raise InputError(str(error), self._place) from error
        self.is_plane, self.is_distance = self._shape.is_plane, self._shape.is_distance
        self.is_timed = self.moves = self._shape.is_timed or self._moved is not None
        self._shape_findings = [finding.at(self._place) for finding in self._shape.findings]
        self._is_placed = False

    @property
    def _body(self) -> Distance:
        """The body at rest, as it is at present."""
        return self._shape.at(self._clock.now)

    def gap(self, x: FloatArray) -> FloatArray:
        return self._evaluated(self.now.gap, x)

    def _evaluated(self, function: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
        """A function of points (d, k); collective, as an expression may fail on one rank only."""

        def values() -> FloatArray:
            with np.errstate(all="ignore"):
                return with_key(self._place, lambda: function(x))

        return agree(self._comm, values)

    def motion(self) -> RigidMotion:
        moved = self._moved
        if moved is None:
            return RigidMotion.rest(self._dim)
        try:
            return moved.at(self._clock.now, self._dim)
        except InputError as error:
            raise InputError(str(error), f"{self._key}.motion.{error.key}") from error

    @property
    def now(self) -> Distance:
        """The body at its present place."""
        return MovedDistance(self._body, self.motion()) if self.moves else self._body

    def drag(self, surface: ContactSurface, before: RigidMotion) -> FloatArray:
        return self.motion().step_from(before, surface.points.T).T

    def at_nodes(self, surface: ContactSurface) -> tuple[FloatArray, FloatArray]:
        shape, is_placed, self._is_placed = self._shape, self._is_placed, True
        try:
            return self._at_nodes(surface)
        except Misplaced:
            if is_placed or not (isinstance(shape, FacetedFoundation) and shape.is_around):
                raise
            # The outline may be that of a tool in the other order, not of a die around the body.
            self._shape = shape.reversed()
            with suppress(Misplaced):
                placed = self._at_nodes(surface)
                finding = Finding("foundation.turned", self._place, advice=shape.turn)
                self._shape_findings.append(finding)
                return placed
            self._shape = shape
            raise

    def _at_nodes(self, surface: ContactSurface) -> tuple[FloatArray, FloatArray]:
        body, points, comm = self.now, surface.places.T, self._comm
        if isinstance(self._shape, OwnShape):
            at_rest = self.motion().origin(points)
            agree(comm, lambda: with_key(self._place, lambda: _check_own(self._body, at_rest)))
        gap = self._evaluated(body.gap, points)
        # A foundation that is back where it touched would press by the rounding of the coordinates.
        gap = np.where(np.abs(gap) <= _TOUCH * maximum(comm, np.abs(points)), 0.0, gap)
        normals = self._evaluated(body.contact_normal, points).T
        if not on_every_rank(comm, np.isfinite(gap) & np.isfinite(normals).all(axis=1)):
            raise InputError(
                _NO_GRADIENT if isinstance(self._body, LevelSetAt) else _TOO_FAR, self._key
            )
        if isinstance(self._body, LevelSetAt):
            low, high = self._slopes(self._body, surface)
            if low <= _ROUNDING * high:
                raise InputError(_NO_GRADIENT, self._key)
        outward = surface.body_normals
        facing = np.sum(normals * outward, axis=1)
        turn, inside = self._shape.turn, gap < 0.0
        # Only a part of Gamma_C need face the foundation; the rest, as the top of a ball, is
        # outside of the foundation and never gets there, but keeps the distance as well.
        if turn and _most(surface, facing < -_SIDEWAYS, inside):
            raise Misplaced(f"{_INSIDE}: {turn}", self._key)
        if on_any_rank(comm, self._at_open_end(points) & inside):
            raise Misplaced(
                "Gamma_C reaches around the end of the open foundation, where it has no inside; "
                "close the foundation, or let it reach beyond the body",
                self._place,
            )
        if isinstance(self._body, FacetedFoundation):
            sideways = inside & (facing < _SIDEWAYS)
            gap[sideways], normals[sideways] = self._way_out(
                self._body, surface, points[:, sideways], outward[sideways]
            )
        elif on_any_rank(comm, inside & (facing <= 0.0)):
            raise Misplaced(_TOO_DEEP + self._shape.turn_normal, self._key)
        # A foundation with several sides may come from where nothing faces it yet.
        if not turn and on_every_rank(comm, facing <= _ALONG):
            behind = _BEHIND.format(on=self._key.removesuffix("foundation") + "on")
            raise Misplaced(behind + self._shape.turn_normal, self._key)
        return gap, normals

    def _way_out(
        self,
        body: FacetedFoundation,
        surface: ContactSurface,
        points: FloatArray,
        outward: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """The gap (k,) and the contact normal (k, d) along the normals of the body; collective.

        ``points`` (d, k) are inside, near a side of the foundation that the body does not face, as
        beside a sharp edge: the way out is that against the outward normals (k, d) of the body.
        """
        motion = self.motion()
        depth, normals = body.way_out(motion.origin(points), -motion.turn.T @ outward.T)
        low, high = surface.domain.bounding_box
        if maximum(self._comm, depth) > (high - low).min():
            raise Misplaced(_TOO_FAR_IN, self._key)
        return -depth, -(motion.turn @ normals).T

    def distance(self, x: FloatArray) -> FloatArray:
        try:
            distance = self._evaluated(self.now.gap, x)
        except InputError:
            # An expression need have a value on Gamma_C only.
            return super().distance(x)
        is_known = np.isfinite(distance) & ~self._at_open_end(x)
        return np.where(is_known, distance, np.inf)

    def opening(self, x: FloatArray, u_normal: FloatArray, moved: FloatArray) -> FloatArray:
        return self.distance(moved)

    def corners(self, box: FloatArray, spacing: float) -> FloatArray:
        if not isinstance(self._body, FacetedFoundation):
            return super().corners(box, spacing)
        motion, middle = self.motion(), box.mean(axis=0)
        # The box around the ball around the box, where the foundation was at rest.
        reach = 0.5 * float(np.linalg.norm(box[1] - box[0]))
        at_rest = motion.origin(middle[:, None])[:, 0] + np.array([[-reach], [reach]])
        return motion.moved(self._body.sharp_points(at_rest, spacing).T).T

    def findings(self, surface: ContactSurface, gap: FloatArray) -> list[Finding]:
        findings, comm = [*self._shape_findings], self._comm
        body = self._body

        def add(kind: str, key: str = self._place, **numbers: Any) -> None:
            findings.append(Finding(f"foundation.{kind}", key, **numbers))

        if not self.moves:
            normals = self._evaluated(body.contact_normal, surface.points.T).T
            facing = np.sum(normals * surface.body_normals, axis=1)
            if on_every_rank(comm, np.abs(facing) <= _ALONG):
                add("right_angles")
        if isinstance(body, LevelSetAt):
            low, high = self._slopes(body, surface)
            if low < _LEAST_SLOPE or high > 1.0 / _LEAST_SLOPE:
                add("gradient", low=low, high=high)
        if on_any_rank(comm, self._at_open_end(surface.points.T)):
            add("end")
        extent = surface.domain.extent
        if isinstance(body, FacetedFoundation):
            ratio = body.extent / extent
            if not 1.0 / _LARGE_RATIO < ratio < _LARGE_RATIO:
                add("size", size=body.extent, extent=extent)
        distance = -maximum(comm, -gap, -np.inf)
        if distance > extent:
            add("far", self._key, distance=distance, extent=extent)
        return findings

    def _slopes(self, body: LevelSetAt, surface: ContactSurface) -> tuple[float, float]:
        """The least and the largest ``|grad f|`` at the nodes at present; collective."""
        slope = body.slope(self.motion().origin(surface.points.T))
        return -maximum(self._comm, -slope, -np.inf), maximum(self._comm, slope)

    def _at_open_end(self, points: FloatArray) -> BoolArray:
        if not isinstance(self._body, FacetedFoundation):
            return np.zeros(points.shape[1], dtype=bool)
        return self._body.at_open_end(self.motion().origin(points))


def _most(surface: ContactSurface, marks: BoolArray, among: BoolArray) -> bool:
    """Whether marks (k,) hold on more than half of the measure of some nodes (k,); collective."""
    weights = np.where(among, surface.weights, 0.0)
    sums = surface.domain.comm.allreduce(np.array([weights[marks].sum(), weights.sum()]))
    return bool(2.0 * sums[0] > sums[1])
