"""Elastic supports of the body, which pull as well as push: springs, and terms of a user's form."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem, la
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.fem.compiled import JointForm
from contact_locking.fields.present import Clock, PresentValue
from contact_locking.fields.sampling import Entities, rule
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import minimum
from contact_locking.problem.motions import null_motions
from contact_locking.supports.support import Spring

# The rule of integration of an expression on a facet, beside two displacements.
_DEGREE = 6


class ElasticSupport(ABC):
    """Terms of ``a(u, v)`` that hold the body from outside; ``on`` names them among reactions."""

    on: str

    @abstractmethod
    def form(self, u: Expr, v: Expr) -> ufl.Form:
        """The share of ``a(u, v)``."""

    @abstractmethod
    def all_around(self, u: Expr, v: Expr) -> ufl.Form:
        """The same as stiff in all directions."""

    def forces(self, u: fem.Function) -> FloatArray:
        """The forces on the body at local dofs, ghosts included; collective."""
        return -_assembled(self.form(u, ufl.TestFunction(u.function_space)), u)


@dataclass(frozen=True)
class Springs(ElasticSupport):
    """``int k (u . m)(v . m)`` over a part of the boundary, or ``int k u . v``.

    ``stiffness`` is k in UFL, a stress per length, ``along`` the unit vector m in UFL, or None for
    springs in all directions.  ``on`` is the name of the part, and ``measure`` that of the part.
    """

    on: str
    stiffness: Expr
    along: Expr | None
    measure: ufl.Measure

    @classmethod
    def of(cls, domain: Domain, given: Sequence[Spring], clock: Clock) -> list[Springs]:
        """The springs of each boundary part; collective.

        Raises InputError for a stiffness that is not positive somewhere.
        """
        found = []
        for item in given:
            value = PresentValue(item.stiffness, f"{item.key}.stiffness", clock)
            stiffness, along = value.ufl(_DEGREE), None
            if item.along == "normal":
                along = ufl.FacetNormal(domain.mesh)
            elif item.along is not None:
                along = ufl.as_vector(list(np.array(item.along) / np.linalg.norm(item.along)))
            facets = Entities.of(domain, domain.dim - 1, domain.facets(item.on, f"{item.key}.on"))
            if item.stiffness.expression is not None and not item.stiffness.is_constant:
                points, _ = rule(facets.dim, 0, _DEGREE)
                places = np.einsum("qc,kcd->dkq", points, facets.corners)
                least = minimum(domain.comm, value(places.reshape(domain.dim, -1)))
                if not least > 0.0:
                    told = f"must be positive everywhere, and is {least:g} somewhere"
                    raise InputError(told, value.key)
            for name in item.on:
                measure = domain.ds((name,), quadrature_degree=_DEGREE)
                found.append(cls(name, stiffness, along, measure))
        return found

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

    given: ufl.Form
    on: str = "a"

    def form(self, u: Expr, v: Expr) -> ufl.Form:
        test, trial = self.given.arguments()
        return ufl.replace(self.given, {trial: u, test: v})

    def all_around(self, u: Expr, v: Expr) -> ufl.Form:
        """Each component of u and v acts along every axis."""
        size = u.ufl_shape[0]
        axes = [ufl.unit_vector(i, size) for i in range(size)]
        return sum(self.form(u[i] * e, v[i] * e) for i in range(size) for e in axes)


def motions_past(
    springs: Sequence[ElasticSupport], space: fem.FunctionSpace, motions: FloatArray
) -> FloatArray:
    """Coefficients (f, g) of the g motions, of some (f, n) at local dofs, that stretch no spring.

    Collective.
    """
    count, owned = len(motions), space.dofmap.index_map.size_local * space.dofmap.index_map_bs
    if not springs or not count:
        return np.eye(count)
    u, v = fem.Function(space), ufl.TestFunction(space)
    grams = np.zeros((2, count, count))
    for kind, name in enumerate(("form", "all_around")):
        forms = sum(getattr(item, name)(u, v) for item in springs)
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
