"""The limits of the study file as sets of strains on the mesh; the ball is part of the material."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.expressions import SMALLEST
from contact_locking.fem.spaces import Element
from contact_locking.laws.locking import deviator, weighted
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import minimum, on_any_rank
from contact_locking.parameters import MaterialParameters, StrainLimit
from contact_locking.problem.coefficients import Points
from contact_locking.problem.strain_sets import HalfSpaceSet, NormSet, StrainSet


def build_strain_sets(
    domain: Domain, given: MaterialParameters, element: Element, warnings: list[str]
) -> tuple[StrainSet, ...]:
    """All sets of strains but the ball, at the points of the element's strains; collective.

    Deviators, and volumes, of several regions are one set.  Raises InputError for a limit that is
    not positive (a lower limit that is not negative) somewhere, and for a direction that is zero.
    Adds a warning for data that change sharply inside of cells.
    """
    return _Builder(domain, Points(domain, element, warnings)).sets(given)


class _Builder:
    """Evaluates limits; numbers of points are those of :class:`Points`."""

    def __init__(self, domain: Domain, points: Points) -> None:
        self._domain, self._points = domain, points
        self._dim = domain.kinematics.tensor_size(domain.dim)

    def sets(self, given: MaterialParameters) -> tuple[StrainSet, ...]:
        dim = self._dim
        shape, volume, compression = (self._nowhere() for _ in range(3))
        along: list[StrainSet] = []
        for limit, where, key in self._limits(given):
            match limit.norm:
                case "deviator":
                    shape[where] = self._upper(limit, where, key)
                case "volume":
                    volume[where] = self._upper(limit, where, key) / math.sqrt(dim)
                    compression[where] = self._lower(limit, where, key) / math.sqrt(dim)
                case "direction":
                    along += self._direction(limit, where, key)
                case "weighted":
                    along.append(self._weighted(limit, where, key))
        identity = ufl.Identity(dim) / math.sqrt(dim)
        least = math.sqrt(1.0 - dim / 3.0)
        found: list[StrainSet] = []
        if self._is_anywhere(shape):
            inverse = self._inverse(shape)
            found.append(NormSet("deviator", inverse, deviator, deviator, least))
        for name, limits, normal in (
            ("volume at_most", volume, identity),
            ("volume at_least", compression, -identity),
        ):
            if self._is_anywhere(limits):
                found.append(HalfSpaceSet(name, self._inverse(limits), normal))
        return (*found, *along)

    def _limits(self, given: MaterialParameters) -> Iterator[tuple[StrainLimit, IndexArray, str]]:
        """Every limit but balls, the points that it belongs to, and its key."""
        sections = [(given.limits, "material.locking")]
        owner = np.zeros(len(self._points.all), dtype=np.int32)
        for name, region in given.regions.items():
            if region.limits is not None:
                key = f"material.regions.{name}"
                owner[self._points.of(self._domain.cells(name, key))] = len(sections)
                sections.append((region.limits, f"{key}.locking"))
        for number, (limits, key) in enumerate(sections):
            where = np.flatnonzero(owner == number).astype(np.int32)
            for index, limit in enumerate(limits):
                if limit.norm != "strain":
                    yield limit, where, f"{key}.{index}"

    def _direction(self, limit: StrainLimit, where: IndexArray, key: str) -> Iterator[HalfSpaceSet]:
        """The half spaces ``a . eps a <= M`` and ``-a . eps a <= -m``."""
        assert limit.along is not None
        # The hoop component of an axisymmetric body may be left out.
        values = np.zeros((len(where), self._dim))
        for axis, component in enumerate(limit.along):
            place = f"{key}.along.{axis}"
            values[:, axis] = self._points.evaluate(component, where, place)
        largest = np.abs(values).max(axis=1, initial=0.0)
        if on_any_rank(self._domain.comm, largest == 0.0):
            raise InputError("the direction is the zero vector somewhere", f"{key}.along")
        # Scaled first, so that the squares of tiny and huge components are numbers.
        values /= largest[:, None]
        values /= np.linalg.norm(values, axis=1)[:, None]
        direction = self._field((self._dim,), values, where)
        normal = ufl.outer(direction, direction)
        for name, limits, side in (
            ("at_most", self._upper(limit, where, key), normal),
            ("at_least", self._lower(limit, where, key), -normal),
        ):
            if self._is_anywhere(limits):
                inverse = self._inverse(limits, where)
                yield HalfSpaceSet(f"{key.partition('.')[2]} {name}", inverse, side)

    def _weighted(self, limit: StrainLimit, where: IndexArray, key: str) -> NormSet:
        """``|C eps| <= M``, divided by the largest singular value of C."""
        assert limit.matrix is not None
        size = len(limit.matrix)
        values = np.empty((len(where), size, size))
        for i, row in enumerate(limit.matrix):
            for j, entry in enumerate(row):
                place = f"{key}.matrix.{i}.{j}"
                values[:, i, j] = self._points.evaluate(entry, where, place)
        scale = np.abs(values).max(axis=(1, 2), initial=0.0)
        values /= np.where(scale > 0.0, scale, 1.0)[:, None, None]
        singular = np.linalg.svd(values, compute_uv=False).reshape(len(where), size)
        largest = np.where(scale > 0.0, singular[:, 0], 1.0)
        values /= largest[:, None, None]
        with np.errstate(divide="ignore"):  # a matrix that is zero limits nothing
            limits = self._upper(limit, where, key) / (largest * scale)
        self._check(limits, f"{key}.at_most", "the limit over the norm of the matrix")
        comm, relative = self._domain.comm, singular[:, -1] / largest
        least = min(1.0, minimum(comm, relative))
        matrix = self._field((size, size), values, where)
        return NormSet(
            key.partition(".")[2],
            self._inverse(limits, where),
            partial(weighted, matrix=matrix),
            partial(weighted, matrix=ufl.transpose(matrix)),
            least,
        )

    def _upper(self, limit: StrainLimit, where: IndexArray, key: str) -> FloatArray:
        """M at the given points; collective."""
        place = f"{key}.at_most"
        values = self._points.evaluate(limit.upper, where, place, infinite=True)
        self._check(values, place, "the limit")
        return values

    def _lower(self, limit: StrainLimit, where: IndexArray, key: str) -> FloatArray:
        """-m at the given points; collective."""
        if limit.lower == -math.inf:
            return np.full(len(where), np.inf)
        place = f"{key}.at_least"
        values = -self._points.evaluate(limit.lower, where, place)
        self._check(values, place, "minus the lower limit")
        return values

    def _check(self, limits: FloatArray, key: str, what: str) -> None:
        """Raise InputError for limits that do not keep 0 inside of the set; collective."""
        smallest = minimum(self._domain.comm, limits)
        if not smallest > 0.0:
            raise InputError(
                f"{what} must be positive, so that the body without strain is inside of the set; "
                f"it reaches {smallest:g}",
                key,
            )
        if smallest < SMALLEST:
            raise InputError(f"{what} must be at least {SMALLEST:g}, it reaches {smallest:g}", key)

    def _nowhere(self) -> FloatArray:
        return np.full(len(self._points.all), np.inf)

    def _is_anywhere(self, limits: FloatArray) -> bool:
        """Whether any point of any rank has a limit; collective."""
        return on_any_rank(self._domain.comm, np.isfinite(limits))

    def _inverse(self, limits: FloatArray, where: IndexArray | None = None) -> fem.Function:
        """1/M in the space of strains, 0 at all other points."""
        inverse = fem.Function(self._points.space)
        where = self._points.all if where is None else where
        inverse.x.array[self._points.dofs[where]] = 1.0 / limits
        return inverse

    def _field(self, shape: tuple[int, ...], values: FloatArray, where: IndexArray) -> Expr:
        """Values at the given points as a function in the space of strains; collective."""
        field = self._points.tensors(shape)
        dofs = field.function_space.dofmap.list.reshape(-1)
        field.x.array.reshape(-1, *shape)[dofs[where]] = values
        return field
