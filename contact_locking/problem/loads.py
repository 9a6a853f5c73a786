"""Body force, tractions and pressures in UFL, checked at the quadrature points.

A load is a number or an expression, which needs values at the quadrature points only.  The forms
take the time of an expression from the clock of the problem.  The check warns of a load that the
mesh does not resolve: its integral would be wrong, and meaningless at a pole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import basix
import numpy as np
import ufl
from dolfinx import fem

from contact_locking import _compat
from contact_locking.arrays import AXES, FloatArray, IndexArray
from contact_locking.errors import with_key
from contact_locking.expressions import TIME, Expression, parse
from contact_locking.parallel import agree
from contact_locking.parameters import LoadParameters
from contact_locking.problem.clock import Clock, LargestSoFar, is_timed
from contact_locking.problem.domain import Domain
from contact_locking.problem.lookups import Lookups
from contact_locking.problem.plausibility import about_a_load
from contact_locking.problem.spaces import Element

# The quadrature degree of an expression; test functions of degree 1 or 2 need no more.  The check
# compares with a rule of the other degree, whose points differ and do not include the midpoint of a
# cell.
_DEGREE, _OTHER_DEGREE = 4, 6
# A load is resolved if both rules give the same mean square up to this share.  At a pole like 1/x
# the difference is larger on every mesh; at a jump it is smaller from a handful of facets on.
_RESOLVED = 0.3
# The quadrature points of so many cells or facets are in memory at a time.
_CHUNK = 20_000
_SHAPES = {
    1: basix.CellType.interval,
    2: basix.CellType.triangle,
    3: basix.CellType.tetrahedron,
}


def build_loads(
    domain: Domain,
    given: LoadParameters,
    stiffness: float,
    warnings: list[str],
    element: Element,
    clock: Clock,
) -> Loads:
    """Each body force, traction and pressure as a UFL vector with its measure; collective.

    Raises InputError with the key and the point for a value that is not finite.  Adds a warning for
    a load that the mesh does not resolve, and for a load above the ``stiffness`` of the material.
    """
    found = Loads()
    if given.body_force is not None:
        load = _Load(domain, given.body_force, "loads.body_force", element, clock)
        cells = np.arange(domain.mesh.topology.index_map(domain.dim).size_local, dtype=np.int32)
        largest = load.check(domain.dim, cells, warnings)
        low, high = domain.bounding_box()
        stress = largest * float((high - low).max())
        warnings += about_a_load(stress, stiffness, "loads.body_force")
        found.add(load, domain.dx(**load.metadata), domain.dim, cells)
    on_boundary: list[tuple[tuple[str, ...], str, _Load]] = []
    for i, traction in enumerate(given.tractions):
        key = f"loads.tractions.{i}"
        load = _Load(domain, traction.value, f"{key}.value", element, clock)
        on_boundary.append((traction.on, key, load))
    for i, pressure in enumerate(given.pressures):
        key = f"loads.pressures.{i}"
        load = _Pressure(domain, (pressure.value,), f"{key}.value", element, clock)
        on_boundary.append((pressure.on, key, load))
    for on, key, load in on_boundary:
        measure = domain.ds(on, f"{key}.on", **load.metadata)
        facets = domain.facets(on, f"{key}.on")
        stress = load.check(domain.dim - 1, facets, warnings)
        warnings += about_a_load(stress, stiffness, f"{key}.value")
        found.add(load, measure, domain.dim - 1, facets)
    return found


class Loads:
    """The loads of a problem: ``terms`` pairs each load in UFL with its measure."""

    def __init__(self) -> None:
        self.terms: list[tuple[Any, ufl.Measure]] = []
        self._timed: list[tuple[_Load, int, IndexArray]] = []

    def add(self, load: _Load, measure: ufl.Measure, dim: int, entities: IndexArray) -> None:
        """Add a load on cells or facets, the entities of dimension ``dim``."""
        self.terms.append((load.ufl(), measure))
        if load.timed:
            self._timed.append((load, dim, entities))

    def advance(self, warnings: list[str]) -> None:
        """Put the loads to the present time, and check them; collective.

        Raises InputError for a value that is not finite.  Adds the first warning of each load that
        the mesh does not resolve.
        """
        for load, dim, entities in self._timed:
            load.advance(dim, entities, warnings)


class _Load:
    """One load: a vector of numbers or expressions of x, y[, z] and t."""

    def __init__(
        self,
        domain: Domain,
        values: Sequence[float | str],
        key: str,
        element: Element,
        clock: Clock,
    ) -> None:
        self._domain, self._key, self._element, self._clock = domain, key, element, clock
        names = (*AXES[: domain.dim], TIME)
        self._components: list[Expression] = [
            parse(value, names, tables=clock.tables) for value in values
        ]
        self._lookups = Lookups(domain.mesh, self._components, element.degree, clock)
        self._constant = all(component.is_constant for component in self._components)
        self.timed = any(is_timed(component) for component in self._components)
        # 1, or 0 at the times at which the load is zero with rounding.
        self._acts, self._so_far = fem.Constant(domain.mesh, 1.0), LargestSoFar()
        self._warned = False

    @property
    def metadata(self) -> dict[str, Any]:
        """The quadrature degree for the form compiler."""
        # The factor 2 pi r of an axisymmetric body has the degree 1.
        degree = self._element.degree + int(self._domain.axisymmetric)
        return {"quadrature_degree": degree if self._constant else _DEGREE}

    def ufl(self) -> Any:
        if self._constant:
            numbers = [float(component.numpy()) for component in self._components]
            return fem.Constant(self._domain.mesh, numbers)
        x = ufl.SpatialCoordinate(self._domain.mesh)
        places: dict[str, Any] = {axis: x[i] for i, axis in enumerate(AXES[: self._domain.dim])}
        places[TIME] = self._clock.constant
        tables = self._lookups.coefficients
        load = ufl.as_vector([component.ufl(tables, **places) for component in self._components])
        return self._acts * load if self.timed else load

    def advance(self, dim: int, entities: IndexArray, warnings: list[str]) -> None:
        """Put the load to the present time, with the check of :meth:`check`; collective."""
        self._lookups.refresh()
        self.check(dim, entities, warnings)

    def check(self, dim: int, entities: IndexArray, warnings: list[str]) -> float:
        """The largest ``|g|`` at the quadrature points of cells or facets; collective.

        A load that depends on the time is put to zero where it is zero with rounding.  Raises and
        warns as `build_loads`.
        """
        largest = self._largest(dim, entities, warnings)
        is_zero = self._so_far.hides(largest)
        self._acts.value = float(not (self.timed and is_zero))
        return largest

    def _largest(self, dim: int, entities: IndexArray, warnings: list[str]) -> float:
        if self._constant:
            return float(np.linalg.norm([component.numpy() for component in self._components]))
        comm = self._domain.comm
        first = agree(comm, lambda: self._sample(dim, entities, _DEGREE))
        second = agree(comm, lambda: self._sample(dim, entities, _OTHER_DEGREE))
        squares = comm.allreduce(np.array([first.square, second.square]))
        largest, where = max(
            pair for pairs in comm.allgather((first.top, second.top)) for pair in pairs
        )
        if largest <= 0.0:
            # A load that depends on the time may be zero at times.
            if self.timed:
                return 0.0
            warnings.append(
                f"{self._key}: is zero at all points of the quadrature; is the load meant for "
                "another place, or for a place smaller than the elements?"
            )
            return 0.0
        if abs(squares[0] - squares[1]) <= _RESOLVED * squares.max() or self._warned:
            return largest
        self._warned = True
        place = ", ".join(f"{a} = {v:.6g}" for a, v in zip(AXES, where, strict=False))
        warnings.append(
            f"{self._key}: changes too sharply for this mesh near {place}, where it reaches "
            f"{largest:.3g}; its resultant may be wrong: refine the mesh there, or give a load "
            "without a pole"
        )
        return largest

    def _component_key(self, i: int) -> str:
        """The key of a component in the study file."""
        return f"{self._key}.{i}"

    def _sample(self, dim: int, entities: IndexArray, degree: int) -> _Sample:
        total, largest, where = 0.0, -1.0, (0.0,) * self._domain.dim
        for x, weights in _quadrature(self._domain, dim, entities, degree):
            places: dict[str, Any] = dict(zip(AXES, x.T, strict=False))
            places[TIME] = self._clock.now
            size = np.zeros(len(x))
            for i, component in enumerate(self._components):
                values = with_key(self._component_key(i), partial(component.numpy, **places))
                size = np.hypot(size, values)
            total += float(weights @ size**2)
            top = int(np.argmax(size))
            if size[top] > largest:
                largest, where = float(size[top]), tuple(x[top].tolist())
        return _Sample(total, (largest, where))


class _Pressure(_Load):
    """One load ``-p nu`` along the outward normal of the mesh: p is the only component."""

    def ufl(self) -> Any:
        return -super().ufl()[0] * ufl.FacetNormal(self._domain.mesh)

    def _component_key(self, i: int) -> str:
        return self._key


@dataclass(frozen=True)
class _Sample:
    """``int |g|^2``, and the largest ``|g|`` with its point, from the points of this rank."""

    square: float
    top: tuple[float, tuple[float, ...]]


def _quadrature(
    domain: Domain, dim: int, entities: IndexArray, degree: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Points (k, d) and weights (k,) of the form compiler's quadrature rule, in chunks."""
    points, weights = basix.make_quadrature(_SHAPES[dim], degree)
    shares = np.column_stack([1.0 - points.sum(axis=1), points])
    mesh = domain.mesh
    nodes = mesh.geometry.x[:, : domain.dim]
    for start in range(0, len(entities), _CHUNK):
        chunk = entities[start : start + _CHUNK]
        whole = dim == domain.dim
        corners = nodes[
            _compat.cell_nodes(mesh)[chunk]
            if whole
            else _compat.entities_to_geometry(mesh, dim, chunk)
        ]
        edges = corners[:, 1:] - corners[:, :1]
        scale = np.sqrt(np.linalg.det(edges @ np.swapaxes(edges, 1, 2)))
        x = np.einsum("qc,kcd->kqd", shares, corners).reshape(-1, domain.dim)
        yield x, np.outer(scale, weights).reshape(-1)
