"""The loads in UFL, with rules of integration that see them, and elastic supports of the body.

An expression is evaluated at the quadrature points, at the time of the clock of the problem.  Where
a load is narrower than a cell or facet, the rule subdivides these, so that the resultant is right.
Other data of a script are integrated with the degree that UFL estimates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import ufl
from dolfinx import fem, la
from ufl.core.expr import Expr

from contact_locking.arrays import LARGEST, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.fem.compiled import JointForm, integral
from contact_locking.fem.fields import (
    Clock,
    Entities,
    LargestSoFar,
    PresentValue,
    rule,
)
from contact_locking.fem.spaces import Element
from contact_locking.findings import TEXTS, Finding
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, minimum
from contact_locking.problem.motions import null_motions
from contact_locking.supports.support import BodyForce, Load, Pressure, Spring, TotalForce
from contact_locking.values.concept import ONLY

# The rule of integration of an expression on a facet, beside two displacements.
_SPRING_DEGREE = 6


class ElasticSupport(ABC):
    """Terms of ``a(u, v)`` that support the body; ``on`` is their name among the reactions."""

    on: str

    @abstractmethod
    def form(self, u: Expr, v: Expr) -> ufl.Form:
        """The terms."""

    @abstractmethod
    def all_around(self, u: Expr, v: Expr) -> ufl.Form:
        """The terms, with the stiffness in all directions."""

    def forces(self, u: fem.Function) -> FloatArray:
        """The forces on the body at local dofs, ghosts included; collective."""
        return -_assembled(self.form(u, ufl.TestFunction(u.function_space)), u)


@dataclass(frozen=True)
class Springs(ElasticSupport):
    """``int k (u . m)(v . m)`` over a part of the boundary, or ``int k u . v``.

    - ``stiffness``: k in UFL, a stress per length
    - ``along``: the unit vector m in UFL, None for springs in all directions
    - ``on``, ``measure``: the name of the part and its measure
    """

    on: str
    stiffness: Expr
    along: Expr | None
    measure: ufl.Measure

    @classmethod
    def of(cls, domain: Domain, springs: Sequence[Spring], clock: Clock) -> list[Springs]:
        """The springs of each boundary part; collective.

        Raises InputError for a stiffness that is not positive somewhere.
        """
        placed = []
        for spring in springs:
            value = PresentValue(spring.stiffness, f"{spring.key}.stiffness", clock)
            stiffness, along = value.ufl(_SPRING_DEGREE), None
            if spring.along == "normal":
                along = ufl.FacetNormal(domain.mesh)
            elif spring.along is not None:
                along = ufl.as_vector(list(np.array(spring.along) / np.linalg.norm(spring.along)))
            facets = Entities.of(
                domain, domain.dim - 1, domain.facets(spring.on, f"{spring.key}.on")
            )
            if spring.stiffness.expression is not None and not spring.stiffness.is_constant:
                points, _ = rule(facets.dim, 0, _SPRING_DEGREE)
                places = np.einsum("qc,kcd->dkq", points, facets.corners)
                least = minimum(domain.comm, value(places.reshape(domain.dim, -1)))
                if not least > 0.0:
                    message = f"must be positive everywhere, and is {least:g} somewhere"
                    raise InputError(message, value.key)
            for name in spring.on:
                measure = domain.ds((name,), quadrature_degree=_SPRING_DEGREE)
                placed.append(cls(name, stiffness, along, measure))
        return placed

    def form(self, u: Expr, v: Expr) -> ufl.Form:
        if self.along is None:
            return self.all_around(u, v)
        stretched = ufl.dot(u, self.along) * ufl.dot(v, self.along)
        return self.stiffness * stretched * self.measure

    def all_around(self, u: Expr, v: Expr) -> ufl.Form:
        return self.stiffness * ufl.inner(u, v) * self.measure


@dataclass(frozen=True)
class OwnSupport(ElasticSupport):
    """The terms of a user's ``a(u, v)`` on facets, and in cells with u and v themselves."""

    bilinear: ufl.Form
    on: str = "a"

    def form(self, u: Expr, v: Expr) -> ufl.Form:
        test, trial = self.bilinear.arguments()
        return ufl.replace(self.bilinear, {trial: u, test: v})

    def all_around(self, u: Expr, v: Expr) -> ufl.Form:
        """Each component of u and v acts along every axis."""
        size = u.ufl_shape[0]
        axes = [ufl.unit_vector(i, size) for i in range(size)]
        return sum(self.form(u[i] * e, v[i] * e) for i in range(size) for e in axes)


def motions_past(
    springs: Sequence[ElasticSupport], space: fem.FunctionSpace, motions: FloatArray
) -> FloatArray:
    """Coefficients (f, g) of the g motions, of f given ones (f, n), that stretch no spring.

    Collective.
    """
    count, owned = len(motions), space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    if not springs or not count:
        return np.eye(count)
    u, v = fem.Function(space), ufl.TestFunction(space)
    grams = np.zeros((2, count, count))
    for kind, name in enumerate(("form", "all_around")):
        forms = sum(getattr(spring, name)(u, v) for spring in springs)
        for number, motion in enumerate(motions):
            u.x.array[:] = motion
            grams[kind, number] = motions[:, :owned] @ _assembled(forms, u)[:owned]
    stretched, everywhere = space.mesh.comm.allreduce(grams)
    return null_motions(stretched, np.diag(everywhere))


def _assembled(form: ufl.Form, u: fem.Function) -> FloatArray:
    dofmap = u.function_space.dofmap
    vector = la.vector(dofmap.index_map, dofmap.index_map_bs)
    JointForm(form).assemble_vector(vector)
    vector.scatter_forward()
    return np.asarray(vector.array)


# The quadrature degree of an expression in each part of a cell or facet, enough for test functions
# of degree 1 or 2.  The rule for comparison has a higher degree and parts half as long.
_DEGREE, _HIGHER_DEGREE = 4, 6
# A rule is accepted if the integrals over all cells or facets are right to the first share of the
# load; above the second there is a warning, and above the last the load is refused.
_ACCURATE, _UNCERTAIN, _LOST = 1e-3, 0.03, 0.3


class LoadOnMesh:
    """A load: its ``density`` in UFL, a vector, on a ``measure``.

    ``halvings`` says how often the rule of integration halves each cell or facet: as few times as
    the integrals need at the present and some planned times, and ``findings`` are about the load
    at the times so far.  The constructor and :meth:`advance` are collective, and raise InputError
    with key and point for a value that is not finite, and for a load that the rule mostly misses.
    """

    def __init__(self, domain: Domain, element: Element, concept: Load, clock: Clock) -> None:
        self._domain, self._element, self._clock = domain, element, clock
        name, dim = concept.key_of("value"), domain.dim
        self.key = concept.key if name == ONLY else f"{concept.key}.{name}"
        components = concept.value if isinstance(concept.value, tuple) else (concept.value,)
        is_vector = isinstance(concept.value, tuple)
        self._values = [
            PresentValue(value, f"{self.key}.{i}" if is_vector else self.key, clock)
            for i, value in enumerate(components)
        ]
        self._constant = all(value.is_constant for value in components)
        self._is_seen = all(value.expression is not None for value in components)
        self.is_timed = any(value.is_timed for value in components)
        # 1, or 0 at times when the load is only rounding.
        self._acts, self._so_far = fem.Constant(domain.mesh, 1.0), LargestSoFar()
        self.findings: list[Finding] = []
        if isinstance(concept, BodyForce):
            owned = domain.mesh.topology.index_map(dim).size_local
            self._on = Entities.of(domain, dim, np.arange(owned, dtype=np.int32))
        else:
            self._on = Entities.of(domain, dim - 1, domain.facets(concept.on, f"{concept.key}.on"))
        self.density = ufl.as_vector([value.ufl(element.degree) for value in self._values])
        self.halvings = 0
        if self._is_seen and not self._constant:
            for time in clock.some_times if self.is_timed else [clock.now]:
                # No less often than before, and as often as the integrals need.
                fine = self._sample(self._on.halvings, _HIGHER_DEGREE, time)
                most = max(self._on.halvings - 1, 0)
                while (
                    self.halvings < most
                    and self._apart(self._sample(self.halvings, _DEGREE, time), fine) > _ACCURATE
                ):
                    self.halvings += 1
            self.density = self._acts * self.density if self.is_timed else self.density
        self._size, self._per = 0.0, 1.0
        if isinstance(concept, BodyForce):
            self.measure, (low, high) = domain.dx(**self.metadata), domain.bounding_box
            self._per = float((high - low).max())
        else:
            self.measure = domain.ds(concept.on, **self.metadata)
        if isinstance(concept, TotalForce):
            # Spread evenly over the part of the boundary.
            area = integral(domain, fem.Constant(domain.mesh, 1.0) * self.measure)
            self._per, self.density = 1.0 / area, self.density / area
        elif isinstance(concept, Pressure):
            self.density = -self.density[0] * ufl.FacetNormal(domain.mesh)

    @property
    def stress(self) -> float:
        """The largest size at present, as a stress."""
        return self._per * self._size

    @property
    def metadata(self) -> dict[str, Any]:
        """The rule of integration, for the compiler of forms."""
        if not self._is_seen:
            return {}
        if self._constant:
            # The factor 2 pi r of an axisymmetric body has the degree 1, and so has the Jacobian of
            # a box in each coordinate.
            factor = int(self._domain.axisymmetric or self._element.boxes)
            return {"quadrature_degree": self._element.degree + factor}
        metadata: dict[str, Any] = {"quadrature_degree": _DEGREE}
        if self.halvings > 0:
            points, weights = self._on.reference_rule(self.halvings, _DEGREE)
            metadata |= {
                "quadrature_rule": "custom",
                "quadrature_points": tuple(tuple(map(float, point)) for point in points),
                "quadrature_weights": tuple(map(float, weights)),
            }
        return metadata

    def advance(self) -> None:
        """Update the load to the present time; collective.

        A load that depends on the time is set to zero at times when it is only rounding.
        """
        for value in self._values:
            value.refresh()
        self._size = self._largest()
        self._acts.value = float(not (self.is_timed and self._so_far.hides(self._size)))

    def _largest(self) -> float:
        """The largest ``|g|`` at the points of cells or facets; collective."""
        if not self._is_seen:
            return 0.0
        if self._constant:
            return float(np.linalg.norm([float(value.value) for value in self._values]))
        comm, time = self._domain.comm, self._clock.now
        used = agree(comm, lambda: self._sample(self.halvings, _DEGREE, time, is_used=True))
        fine = self._sample(self._on.halvings, _HIGHER_DEGREE, time)
        share = self._apart(used, fine)
        tops = [top for pair in comm.allgather((used.top, fine.top)) for top in pair]
        largest, where = max(tops)
        if largest <= 0.0:
            # A load that depends on the time may be zero at times.
            self.findings += [] if self.is_timed else [Finding("load.zero", self.key)]
            return 0.0
        is_nodal = any(value.is_nodal for value in self._values)
        nodes = " (its table counts at the nodes alone)" if is_nodal else ""
        about: dict[str, Any] = {"place": where, "size": largest, "per_cent": 100.0 * share}
        if share > _LOST:
            raise InputError(TEXTS["load.sharp"].format(nodes=nodes, **about), self.key)
        if share > _UNCERTAIN and not self.findings:
            self.findings.append(Finding("load.sharp", self.key, nodes=nodes, **about))
        return largest

    def _apart(self, coarse: _Sample, fine: _Sample) -> float:
        """How far integrals differ, as a share of ``int |g|``; collective."""
        difference = np.linalg.norm(coarse.integrals - fine.integrals, axis=1).sum()
        total, whole = self._domain.comm.allreduce(np.array([difference, fine.size]))
        return float(total / whole) if whole > 0.0 else 0.0

    def _at(
        self, x: FloatArray, time: float, used: Mapping[Any, FloatArray] | None = None
    ) -> FloatArray:
        """The components (k, c) at points (k, d).

        ``used`` are the values (k,) of tables in the forms, if the forms use the points.  Then
        InputError is raised for a value that is no number; at other points such a value is zero.
        """
        components = np.empty((len(x), len(self._values)))
        for i, value in enumerate(self._values):
            if used is not None:
                with_key(value.key, partial(value.value.at, x.T, time))
            components[:, i] = value.value.unchecked(x.T, time, used)
        return np.where(np.abs(components) <= LARGEST, components, 0.0)

    def _sample(self, halvings: int, degree: int, time: float, is_used: bool = False) -> _Sample:
        points, weights = rule(self._on.dim, halvings, degree)
        integrals = np.zeros((len(self._on.corners), len(self._values)))
        size, top = 0.0, (-1.0, "")
        for chunk, x in self._on.chunks(points):
            places = x.reshape(-1, x.shape[2])
            used = None
            if is_used:
                corners = self._on.corners[chunk]
                parts = [value.in_simplices(corners, points, time) for value in self._values]
                used = {table: values for by_table in parts for table, values in by_table.items()}
            vectors = self._at(places, time, used)
            sizes = np.linalg.norm(vectors, axis=1)
            by_entity = vectors.reshape(*x.shape[:2], -1)
            measures = self._on.sizes[chunk]
            integrals[chunk] = measures[:, None] * np.einsum("q,kqc->kc", weights, by_entity)
            size += float(measures @ (sizes.reshape(x.shape[:2]) @ weights))
            largest = int(np.argmax(sizes))
            if sizes[largest] > top[0]:
                top = (float(sizes[largest]), self._domain.where(places[largest]))
        return _Sample(integrals, size, top)


@dataclass(frozen=True)
class _Sample:
    """A load at the points of a rule, on the cells or facets (n,) of this rank.

    ``integrals`` (n, c) are those of the components, ``size`` is ``int |g|``, and ``top`` the
    largest ``|g|`` with its place in words.
    """

    integrals: FloatArray
    size: float
    top: tuple[float, str]
