"""Body force, tractions, pressures and springs in UFL, with rules of integration that see them.

A load is a number or an expression, which needs values at the quadrature points only.  The forms
take the time of an expression from the clock of the problem.  Where a load is narrower than a cell
or facet, the rule divides the cell or facet into parts, so that the resultant is right.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from contact_locking.arrays import AXES, LARGEST, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import TIME, Lookup
from contact_locking.fem.compiled import integral
from contact_locking.fem.spaces import Element
from contact_locking.fields.clock import Clock, LargestSoFar
from contact_locking.fields.lookups import Lookups
from contact_locking.fields.plausibility import about_a_load
from contact_locking.fields.sampling import Entities, features, refuse_poles, rule
from contact_locking.fields.values import evaluate
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, minimum
from contact_locking.problem.springs import Springs
from contact_locking.study_file.parameters.boundary import LoadParameters, Spring
from contact_locking.values.value import Value

# The quadrature degree of an expression in each part of a cell or facet; test functions of degree 1
# or 2 need no more.  The rule for comparison has a higher degree and parts half as long.
_DEGREE, _HIGHER_DEGREE = 4, 6
# A rule is good enough if the integrals over all cells or facets are right to this share of the
# load.  A load of which the next share is uncertain is warned of, and the last share is refused.
_ACCURATE, _UNCERTAIN, _LOST = 1e-3, 0.03, 0.3
# Where values are resolved, each difference between two points is below this multiple of those to
# both sides.
_RESOLVED = 2.0
# Integrals over so many cells or facets that differ most are looked at for poles.
_SUSPECTS = 8


def build_loads(domain: Domain, given: LoadParameters, element: Element, clock: Clock) -> Loads:
    """Each body force, traction and pressure as a UFL vector with its measure; collective.

    Raises InputError with the key and the point for a value that is not finite, for a pole, and for
    a load that is mostly lost.
    """
    found = Loads()
    if given.body_force is not None:
        key = "loads.body_force"
        cells = np.arange(domain.mesh.topology.index_map(domain.dim).size_local, dtype=np.int32)
        on = Entities.of(domain, domain.dim, cells)
        load = _Load(on, given.body_force, key, element, clock)
        low, high = domain.bounding_box
        found.add(load, load.ufl(), domain.dx(**load.metadata), float((high - low).max()))
    for kind in ("forces", "tractions", "pressures"):
        for i, item in enumerate(getattr(given, kind)):
            key = f"loads.{kind}.{i}"
            on = Entities.of(domain, domain.dim - 1, domain.facets(item.on, f"{key}.on"))
            load = _Load(on, item.value, f"{key}.value", element, clock)
            measure = domain.ds(item.on, f"{key}.on", **load.metadata)
            vector, stress = load.ufl(), 1.0
            if kind == "forces":
                # Spread evenly over the part of the boundary.
                stress = 1.0 / integral(domain, fem.Constant(domain.mesh, 1.0) * measure)
                vector = stress * vector
            elif kind == "pressures":
                vector = -vector[0] * ufl.FacetNormal(domain.mesh)
            found.add(load, vector, measure, stress)
    return found


class Loads:
    """The loads of a problem: ``terms`` pairs each load in UFL with its measure."""

    def __init__(self) -> None:
        self.terms: list[tuple[Any, ufl.Measure]] = []
        self._timed: list[_Load] = []
        self._told: list[str] = []
        self._stresses: list[tuple[float, str]] = []

    def add(self, load: _Load, vector: Any, measure: ufl.Measure, per: float) -> None:
        """Add a load, in UFL a vector on a measure, that times ``per`` is a stress; collective."""
        largest, told = load.check()
        self._told += told
        self._stresses.append((largest * per, load.key))
        self.terms.append((vector, measure))
        if load.timed:
            self._timed.append(load)

    def work(self, v: Any) -> ufl.Form | None:
        """``(f, v)`` (13), None without loads."""
        if not self.terms:
            return None
        return sum(ufl.inner(load, v) * measure for load, measure in self.terms)

    def warnings(self, stiffness: float) -> list[str]:
        """Loads that no rule of integration resolves, or above the stiffness of the material."""
        large = [about_a_load(stress, stiffness, key) for stress, key in self._stresses]
        return [*self._told, *(text for texts in large for text in texts)]

    def advance(self) -> list[str]:
        """Put the loads to the present time, and check them; collective.

        Returns the first warning of each load that its rule of integration does not resolve.
        Raises InputError for a value that is not finite, and for a pole.
        """
        return [text for load in self._timed for text in load.advance()]


class _Load:
    """One load: a number or expression of x, y[, z] and t, or a vector, on cells or facets.

    ``halvings`` says how often the rule of integration halves each of them; it is the least with
    which the integrals are right at the present time and at the given times.
    """

    def __init__(
        self,
        on: Entities,
        given: Value | tuple[Value, ...],
        key: str,
        element: Element,
        clock: Clock,
    ) -> None:
        domain = self._domain = on.domain
        self._on, self.key, self._element, self._clock = on, key, element, clock
        values = given if isinstance(given, tuple) else (given,)
        self._keys = [key]
        if values is given:
            self._keys = [f"{key}.{i}" for i in range(len(values))]
        self._components = [value.expression for value in values if value.expression is not None]
        self._lookups = Lookups(domain.mesh, self._components, element.degree, clock)
        self._constant = all(component.is_constant for component in self._components)
        self.timed = any(value.is_timed for value in values)
        # 1, or 0 at the times at which the load is zero with rounding.
        self._acts, self._so_far = fem.Constant(domain.mesh, 1.0), LargestSoFar()
        self._warned = False
        self.halvings = 0
        if not self._constant:
            for time in clock.some_times if self.timed else [clock.now]:
                self.halvings = self._enough(time)

    @property
    def metadata(self) -> dict[str, Any]:
        if self._constant:
            # The factor 2 pi r of an axisymmetric body has the degree 1, and so has the Jacobian of
            # a box in each coordinate.
            factor = int(self._domain.axisymmetric or self._element.boxes)
            return {"quadrature_degree": self._element.degree + factor}
        found: dict[str, Any] = {"quadrature_degree": _DEGREE}
        if self.halvings > 0:
            points, weights = self._on.reference_rule(self.halvings, _DEGREE)
            found |= {
                "quadrature_rule": "custom",
                "quadrature_points": tuple(tuple(map(float, point)) for point in points),
                "quadrature_weights": tuple(map(float, weights)),
            }
        return found

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

    def advance(self) -> list[str]:
        """Put the load to the present time, with the check of :meth:`check`; collective."""
        self._lookups.refresh()
        return self.check()[1]

    def check(self) -> tuple[float, list[str]]:
        """The largest ``|g|`` at the points of cells or facets, and warnings; collective.

        A load that depends on the time is put to zero where it is zero with rounding.  Raises
        InputError as `build_loads`.
        """
        largest, told = self._largest()
        is_zero = self._so_far.hides(largest)
        self._acts.value = float(not (self.timed and is_zero))
        return largest, told

    def _largest(self) -> tuple[float, list[str]]:
        if self._constant:
            sizes = [component.numpy() for component in self._components]
            return float(np.linalg.norm(sizes)), []
        comm, time = self._domain.comm, self._clock.now
        used = agree(comm, lambda: self._sample(self.halvings, _DEGREE, time, is_used=True))
        fine = self._sample(self._on.halvings, _HIGHER_DEGREE, time)
        share = self._apart(used, fine, fine.jumps)
        tops = [top for pair in comm.allgather((used.top, fine.top)) for top in pair]
        largest, where = max(tops)
        if largest <= 0.0:
            # A load that depends on the time may be zero at times.
            if self.timed:
                return 0.0, []
            return 0.0, [
                f"{self.key}: is zero at all points of the quadrature; is the load meant for "
                "another place, or for a place smaller than the elements?"
            ]
        if self.halvings or share > _ACCURATE:
            coarse = self._sample(0, _DEGREE, time)
            rest = np.linalg.norm(coarse.integrals - fine.integrals, axis=1)
            suspects = np.argsort(-rest, kind="stable")[:_SUSPECTS].astype(np.int32)

            def size(x: FloatArray) -> FloatArray:
                return np.asarray(np.linalg.norm(self._values(x, time), axis=1))

            agree(comm, lambda: refuse_poles(self._on, suspects, size, self.key))
        nodes = " (its table counts at the nodes alone)" if self._lookups.fields else ""
        text = (
            f"changes too sharply for this mesh near {where}, where it reaches {largest:.3g}; its "
            f"resultant is uncertain by about {100.0 * share:.2g} %{nodes}: refine the mesh there, "
            "or give a load that is wider"
        )
        if share > _LOST:
            raise InputError(text, self.key)
        if share > _UNCERTAIN and not self._warned:
            self._warned = True
            return largest, [f"{self.key}: {text}"]
        return largest, []

    def _enough(self, time: float) -> int:
        """How often to halve at a time, no less than before; collective."""
        fine = self._sample(self._on.halvings, _HIGHER_DEGREE, time)
        most = max(self._on.halvings - 1, 0)
        for halvings in range(self.halvings, most):
            if self._apart(self._sample(halvings, _DEGREE, time), fine) <= _ACCURATE:
                return halvings
        return most

    def _apart(self, one: _Sample, fine: _Sample, jumps: float = 0.0) -> float:
        """How far integrals differ, and ``jumps``, as a share of ``int |g|``; collective."""
        rest = np.linalg.norm(one.integrals - fine.integrals, axis=1).sum() + jumps
        left, whole = self._domain.comm.allreduce(np.array([rest, fine.size]))
        return float(left / whole) if whole > 0.0 else 0.0

    def _values(
        self, x: FloatArray, time: float, used: Mapping[Lookup, FloatArray] | None = None
    ) -> FloatArray:
        """The components (k, c) at points (k, d).

        ``used`` are the values (k,) of tables in the forms, if the forms use the points.  Then
        InputError is raised for a value that is no number; at other points such a value is zero.
        """
        places: dict[str, Any] = {**dict(zip(AXES, x.T, strict=False)), TIME: time}
        found = np.empty((len(x), len(self._components)))
        for i, component in enumerate(self._components):
            if used is not None:
                with_key(self._keys[i], partial(component.numpy, **places))
            found[:, i] = component.unchecked(used, **places)
        return np.where(np.abs(found) <= LARGEST, found, 0.0)

    def _sample(self, halvings: int, degree: int, time: float, is_used: bool = False) -> _Sample:
        points, weights = rule(self._on.dim, halvings, degree)
        integrals = np.zeros((len(self._on.corners), len(self._components)))
        size, jumps, top = 0.0, 0.0, (-1.0, "")
        order = np.argsort(points[:, 1])
        for chunk, x in self._on.chunks(points):
            places = x.reshape(-1, x.shape[2])
            used = None
            if is_used:
                used = self._lookups.in_simplices(self._on.corners[chunk], points, time)
            found = self._values(places, time, used)
            sizes = np.linalg.norm(found, axis=1)
            by_entity = found.reshape(*x.shape[:2], -1)
            measures = self._on.sizes[chunk]
            integrals[chunk] = measures[:, None] * np.einsum("q,kqc->kc", weights, by_entity)
            size += float(measures @ (sizes.reshape(x.shape[:2]) @ weights))
            if self._on.dim == 1:
                along = by_entity[:, order]
                jumps += float(measures @ _uncertain(along, points[order, 1]))
            largest = int(np.argmax(sizes))
            if sizes[largest] > top[0]:
                top = (float(sizes[largest]), self._domain.where(places[largest]))
        return _Sample(integrals, size, top, jumps)


@dataclass(frozen=True)
class _Sample:
    """A load at the points of a rule, on the cells or facets (n,) of this rank.

    ``integrals`` (n, c) are those of the components, ``size`` is ``int |g|``, and ``top`` the
    largest ``|g|`` with its place in words.  Jumps between two points of an edge make ``jumps`` of
    the integrals uncertain.
    """

    integrals: FloatArray
    size: float
    top: tuple[float, str]
    jumps: float


def _uncertain(values: FloatArray, places: FloatArray) -> FloatArray:
    """The uncertainty (k,) of integrals over edges by jumps between points (q,).

    ``values`` (k, q, c) at a point and at the next differ by a jump as far as the differences on
    both sides are smaller; a rule that resolves the values leaves no such difference.
    """
    steps = np.linalg.norm(np.diff(values, axis=1), axis=2)
    beside = np.pad(steps, ((0, 0), (1, 1)))
    jumps = np.maximum(steps - _RESOLVED * (beside[:, :-2] + beside[:, 2:]), 0.0)
    return np.asarray(0.5 * jumps @ np.diff(places))


# The rule of integration of an expression on a facet, beside two displacements.
_OF_SPRINGS = 6


def springs_of(domain: Domain, given: Sequence[Spring]) -> tuple[list[Springs], list[str]]:
    """The springs of each boundary part, and warnings; collective.

    Raises InputError for a stiffness that is not positive somewhere.
    """
    found, told = [], list[str]()
    x = ufl.SpatialCoordinate(domain.mesh)
    places = {axis: x[i] for i, axis in enumerate(AXES[: domain.dim])}
    for number, item in enumerate(given):
        key = f"loads.springs.{number}"
        assert item.stiffness.expression is not None
        stiffness = item.stiffness.expression.ufl({}, **places)
        if item.stiffness.is_constant:
            stiffness = fem.Constant(domain.mesh, stiffness)
        along = _spring_along(domain, item)
        for name in item.on:
            facets = Entities.of(domain, domain.dim - 1, domain.facets((name,), f"{key}.on"))
            told += _spring_warnings(facets, item.stiffness, f"{key}.stiffness")
            measure = domain.ds((name,), f"{key}.on", quadrature_degree=_OF_SPRINGS)
            found.append(Springs(name, stiffness, along, measure))
    return found, told


def _spring_warnings(facets: Entities, value: Value, key: str) -> list[str]:
    if value.is_constant:
        return []
    points, _ = rule(facets.dim, 0, _OF_SPRINGS)
    domain = facets.domain
    places: FloatArray = np.einsum("qc,kcd->kqd", points, facets.corners).reshape(-1, domain.dim)
    values = evaluate(domain.comm, value, places.T, key)
    least = minimum(domain.comm, values)
    if not least > 0.0:
        raise InputError(f"must be positive everywhere, and is {least:g} somewhere", key)
    return features(facets, value, key, "refine the mesh there")


def _spring_along(domain: Domain, item: Spring) -> ufl.core.expr.Expr | None:
    if item.along is None:
        return None
    if item.along == "normal":
        return ufl.FacetNormal(domain.mesh)
    unit = np.array(item.along) / np.linalg.norm(item.along)
    return ufl.as_vector(unit.tolist())
