"""Limits of the strain as they are given, and the sets of strains that they are on the mesh."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import SMALLEST, FloatArray
from contact_locking.errors import InputError
from contact_locking.laws.locking import deviator, weighted
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import minimum, on_any_rank
from contact_locking.problem.points import Points, Sampler, Value, least
from contact_locking.problem.strain_sets import HalfSpaceSet, NormSet, StrainSet

_NEVER = -math.inf


class Limit(Protocol):
    """A closed convex set of strains with 0 in its inside, not yet on a mesh."""

    def on(self, points: Points) -> list[Limited]:
        """The sets at the points of the strains; none for a limit that limits nothing; collective.

        Raises InputError for a limit that is not positive.
        """


class Limited:
    """A set of strains on the mesh, whose limit M is read anew by :meth:`refresh`.

    ``sampler`` gives M (k,) at the points, inf where there is no limit, and ``limits`` is M as it
    was read last.  ``strain_set`` is the set in the forms.
    """

    def __init__(self, points: Points, sampler: Sampler, make: Callable[..., StrainSet]) -> None:
        self._points, self._sampler = points, sampler
        self._inverse = points.function()
        self.strain_set = make(self._inverse)
        self.refresh()

    def refresh(self) -> None:
        """Take the present limits; collective."""
        self.limits = self._sampler()
        self._points.write(self._inverse, np.reciprocal(self.limits))


@dataclass(frozen=True)
class StrainBall:
    """``|eps| <= M`` in the Frobenius norm, the set of the paper.

    ``limit`` is M > 0, without unit: a number, a constant or function of DOLFINx, an expression of
    UFL, or a function of points; inf where nothing locks.  ``key`` names it in messages.
    """

    limit: Value = math.inf
    key: str = "limits"

    def on(self, points: Points) -> list[Limited]:
        limits = _positive(points, self.limit, self.key, "the locking limit")
        return [Limited(points, limits, partial(NormSet, "strain"))]


@dataclass(frozen=True)
class Deviator:
    """``|dev eps| <= M``: the change of shape is limited."""

    at_most: Value
    key: str = "limits"

    def on(self, points: Points) -> list[Limited]:
        dim = points.element.kinematics.tensor_size(points.domain.dim)
        limits = _positive(points, self.at_most, f"{self.key}.at_most", "the limit")
        least_share = math.sqrt(1.0 - dim / 3.0)
        made = partial(
            NormSet, "deviator", linear_map=deviator, adjoint=deviator, least=least_share
        )
        return _where_any(points, limits, made)


@dataclass(frozen=True)
class Volume:
    """``at_least <= tr eps <= at_most``: the change of volume is limited."""

    at_most: Value = math.inf
    at_least: Value = _NEVER
    key: str = "limits"

    def on(self, points: Points) -> list[Limited]:
        dim = points.element.kinematics.tensor_size(points.domain.dim)
        root = math.sqrt(dim)
        return _on_both_sides(points, self, "volume", ufl.Identity(dim) / root, root)


@dataclass(frozen=True)
class Direction:
    """``at_least <= a . eps a <= at_most`` for a unit vector a: fibres along ``along``.

    ``along`` has d components, of any length; that of a body of revolution may have three.  It is
    read once.
    """

    along: Value
    at_most: Value = math.inf
    at_least: Value = _NEVER
    name: str = "direction"
    key: str = "limits"

    def on(self, points: Points) -> list[Limited]:
        size = points.element.kinematics.tensor_size(points.domain.dim)
        values = points.sampler(self.along, f"{self.key}.along", (size,))()
        largest = np.abs(values).max(axis=1, initial=0.0)
        limits = [limit() for _, limit in _both_limits(points, self)]
        is_limited = np.isfinite(limits).any(axis=0)
        if on_any_rank(points.domain.comm, is_limited & (largest == 0.0)):
            raise InputError("the direction is the zero vector somewhere", f"{self.key}.along")
        # Scaled first, so that the squares of tiny and huge components are numbers.
        values /= np.where(largest > 0.0, largest, 1.0)[:, None]
        values /= np.maximum(np.linalg.norm(values, axis=1), 0.5)[:, None]
        direction = points.function((size,))
        points.write(direction, values)
        return _on_both_sides(points, self, self.name, ufl.outer(direction, direction))


@dataclass(frozen=True)
class Weighted:
    """``|C eps| <= M`` for a Mandel matrix C (s, s), which is read once."""

    matrix: Value
    at_most: Value
    name: str = "weighted"
    key: str = "limits"

    def on(self, points: Points) -> list[Limited]:
        domain = points.domain
        size = len(domain.kinematics.mandel_pairs(domain.dim))
        values = points.sampler(self.matrix, f"{self.key}.matrix", (size, size))()
        scale = np.abs(values).max(axis=(1, 2), initial=0.0)
        values /= np.where(scale > 0.0, scale, 1.0)[:, None, None]
        singular = np.linalg.svd(values, compute_uv=False).reshape(len(values), size)
        largest = np.where(scale > 0.0, singular[:, 0], 1.0)
        values /= largest[:, None, None]
        given = _positive(points, self.at_most, f"{self.key}.at_most", "the limit")

        def limits() -> FloatArray:
            with np.errstate(divide="ignore"):  # a matrix that is zero limits nothing
                return np.asarray(given() / (largest * scale))

        told = "the limit over the norm of the matrix"
        require_positive(points.domain, limits(), f"{self.key}.at_most", told)
        limited = np.isfinite(limits())
        relative = singular[limited, -1] / largest[limited]
        bound = min(1.0, minimum(domain.comm, relative))
        matrix = points.function((size, size))
        points.write(matrix, values)
        made = partial(
            NormSet,
            self.name,
            linear_map=partial(weighted, matrix=matrix),
            adjoint=partial(weighted, matrix=ufl.transpose(matrix)),
            least=bound,
        )
        return _where_any(points, limits, made)


@dataclass(frozen=True)
class LimitsOnMesh:
    """All limits of a problem at the points of the strains.

    ``ball`` is the ball of the paper, with M = inf where none is given, and ``others`` are the
    other sets.  ``limit`` is M of the ball in the space of strains, and ``limit_at_peaks`` is M
    where the strain of a cell is largest (`Element.at_peaks`).
    """

    points: Points
    ball: Limited
    others: Sequence[Limited]
    limit: fem.Function
    limit_at_peaks: fem.Function
    peaks: Sequence[tuple[Points, Sampler]] = ()

    @classmethod
    def of(cls, points: Points, given: Sequence[Limit]) -> LimitsOnMesh:
        """The limits at the points; collective.

        Raises InputError for more than one ball, and for limits that are not positive.
        """
        balls = [item for item in given if isinstance(item, StrainBall)]
        if len(balls) > 1:
            raise InputError("has more than one StrainBall; take the smaller limit", balls[1].key)
        ball = balls[0] if balls else StrainBall()
        others = [one for item in given if item not in balls for one in item.on(points)]
        (of_ball,) = ball.on(points)
        limit = at_peaks = points.function()
        peaks = []
        if points.element.at_peaks is not points.element:
            there = Points(points.domain, points.element.at_peaks)
            at_peaks = there.function()
            peaks.append((there, _positive(there, ball.limit, ball.key, "the locking limit")))
        found = cls(points, of_ball, others, limit, at_peaks, peaks)
        found.write()
        return found

    def refresh(self) -> None:
        """Take the present values of all limits; collective."""
        for item in (self.ball, *self.others):
            item.refresh()
        self.write()

    def write(self) -> None:
        """Put M of the ball into the functions; collective."""
        self.points.write(self.limit, self.ball.limits)
        for points, limits in self.peaks:
            points.write(self.limit_at_peaks, limits())


def _where_any(points: Points, limits: Sampler, make: Callable[..., StrainSet]) -> list[Limited]:
    """The set, if any point of any rank has a limit; collective."""
    if not on_any_rank(points.domain.comm, np.isfinite(limits())):
        return []
    return [Limited(points, limits, make)]


def _both_limits(points: Points, given: Volume | Direction) -> list[tuple[str, Sampler]]:
    """The limits of a strain and of minus this strain, with their names; collective."""
    upper = _positive(points, given.at_most, f"{given.key}.at_most", "the limit")
    told = "minus the lower limit"
    lower = _positive(points, given.at_least, f"{given.key}.at_least", told, sign=-1.0)
    return [("at_most", upper), ("at_least", lower)]


def _on_both_sides(
    points: Points, given: Volume | Direction, name: str, normal: Expr, root: float = 1.0
) -> list[Limited]:
    """The half spaces of a strain ``root N : eps`` with the ``normal`` N; collective."""
    found = []
    for (end, limits), n in zip(_both_limits(points, given), (normal, -normal), strict=True):
        scaled = partial(_quotient, limits, root)
        found += _where_any(points, scaled, partial(HalfSpaceSet, f"{name} {end}", normal=n))
    return found


def _quotient(limits: Sampler, root: float) -> FloatArray:
    return np.asarray(limits() / root)


def _positive(points: Points, value: Value, key: str, told: str, sign: float = 1.0) -> Sampler:
    """Limits ``sign M > 0``; collective."""
    values = points.sampler(value, key)

    def limits() -> FloatArray:
        found = np.asarray(sign * values())
        require_positive(points.domain, found, key, told)
        return found

    return limits


def require_positive(domain: Domain, limits: FloatArray, key: str, told: str) -> None:
    """Raise InputError for limits that do not keep 0 inside of the set; collective."""
    smallest = least(domain, limits)
    if not smallest > 0.0:
        raise InputError(
            f"{told} must be positive, so that the body without strain is inside of the set; it "
            f"reaches {smallest:g}",
            key,
        )
    if smallest < SMALLEST:
        raise InputError(f"{told} must be at least {SMALLEST:g}, it reaches {smallest:g}", key)
