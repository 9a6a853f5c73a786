"""The forms of the body in UFL, from the data of a problem."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.contact.nodal_contact import BoundsInForce, NodalContact
from contact_locking.contact.travel import Travel
from contact_locking.errors import InputError
from contact_locking.fem.spaces import Element
from contact_locking.problem.elasticity import EigenstrainOnMesh
from contact_locking.problem.loads import ElasticSupport
from contact_locking.problem.strain_sets import NormSet, StrainSet


@dataclass(frozen=True)
class ProblemData:
    """The data of (25) as UFL.

    - ``elasticity``, ``elastic_stress``: map u and v to ``a(u, v)``, and a strain to its stress
    - ``largest_eigenvalue``: of A at each point
    - ``inverse_limit``, ``limits``: 1/M of the ball, and the other sets of strains
    - ``dx``, ``element``: the measure of the body and the element of the displacements
    - ``loads``: the linear form (f, .) (13) with the work of the eigenstrain, None without loads
    - ``contacts``, ``bounds``: all contacts, and their friction bounds in force
    - ``tools``: the travels of pushed foundations
    - ``own_energy``: maps u to a convex, differentiable J(u), whose derivative is added to (25)
    - ``eigenstrain``, ``springs``: parts of ``loads`` and of ``a(., .)``
    """

    elasticity: Callable[[Expr, Expr], ufl.Form]
    elastic_stress: Callable[[Expr], Expr]
    largest_eigenvalue: Expr
    inverse_limit: fem.Function
    dx: ufl.Measure
    loads: ufl.Form | None
    contacts: tuple[NodalContact, ...]
    bounds: BoundsInForce
    element: Element
    limits: tuple[StrainSet, ...] = ()
    tools: tuple[Travel, ...] = ()
    own_energy: Callable[[fem.Function], Expr] | None = None
    eigenstrain: EigenstrainOnMesh | None = None
    springs: tuple[ElasticSupport, ...] = ()

    def strain(self, u: Expr) -> Expr:
        """``eps(u)`` of the body."""
        return self.element.strain(u)

    @property
    def loose_tools(self) -> tuple[Travel, ...]:
        """The tools without a spring, which only the body stops."""
        return tuple(tool for tool in self.tools if not tool.is_sprung)

    @property
    def is_paired(self) -> bool:
        """Whether bodies touch each other."""
        return any(contact.surface.is_paired for contact in self.contacts)

    @property
    def sets(self) -> tuple[StrainSet, ...]:
        """All sets of strains, the ball first; K is their intersection."""
        return (NormSet("strain", self.inverse_limit), *self.limits)

    @property
    def only_ball(self) -> bool:
        """Whether K is the ball of the paper at every point."""
        return not self.limits

    @property
    def inverse_strain_bound(self) -> Expr:
        """``1/B`` such that ``|eps| <= B`` for all strains in K, 0 where no set implies a bound."""
        bound: Expr = self.inverse_limit
        for limit in self.limits:
            if isinstance(limit, NormSet) and limit.least > 0.0:
                bound = ufl.max_value(bound, limit.least * limit.inverse_limit)
        return bound

    @property
    def locking_dx(self) -> ufl.Measure:
        """The measure ``dx`` with the locking rule of the element."""
        return self.element.locking_dx(self.dx)


def elastic_form(u: Expr, v: Expr, data: ProblemData) -> Expr:
    """``a(u, v) = int A eps(u) : eps(v)``, or the user's form, plus the springs."""
    return sum((spring.form(u, v) for spring in data.springs), data.elasticity(u, v))


def force_magnitudes(u: Expr, v: Expr, data: ProblemData) -> Expr:
    """``int (c/h^2) |u| (v_1 + ... + v_d)``: the size of the summands of ``a(u, .)`` at a node.

    c is the largest eigenvalue of A in a cell, and h is the height of the cell.
    """
    dim = u.ufl_shape[0]
    height = data.element.height(data.dx.ufl_domain(), dim)
    size = data.largest_eigenvalue / height**2 * ufl.sqrt(ufl.inner(u, u))
    dx = data.dx(metadata={"quadrature_degree": 1})
    return size * sum(v[i] for i in range(dim)) * dx


def external_work(v: Expr, data: ProblemData) -> Expr:
    """``(f, v) = int f0 . v + int g . v`` (13)."""
    zero = fem.Constant(data.dx.ufl_domain(), [0.0] * v.ufl_shape[0])
    work = ufl.inner(zero, v) * data.dx
    if data.loads is None:
        return work
    (test,) = data.loads.arguments()
    return work + (data.loads if v == test else ufl.replace(data.loads, {test: v}))


def initial_work(v: Expr, data: ProblemData) -> Expr:
    """``-(A eps_0, eps(v))`` of a body with an eigenstrain."""
    assert data.eigenstrain is not None
    density = ufl.inner(data.eigenstrain.stress, data.strain(v))
    return density * data.element.elastic_dx(data.dx)


def initial_energy(data: ProblemData) -> Expr:
    """``(A eps_0, eps_0)/2`` of a body with an eigenstrain."""
    assert data.eigenstrain is not None
    return data.eigenstrain.energy * data.element.elastic_dx(data.dx)


def require_energy(energy: Callable[[fem.Function], Expr], space: fem.FunctionSpace) -> None:
    """Raise InputError unless ``energy`` is an energy of displacements in the space."""
    if not callable(energy) or isinstance(energy, Expr | ufl.Form):
        raise InputError(
            "must be a function of u that returns J(u), such as a form * ufl.dx", "energy"
        )
    form = energy(fem.Function(space))
    if not isinstance(form, ufl.Form) or form.arguments():
        raise InputError(
            "must return a form without arguments, the integral of a density: density * ufl.dx",
            "energy",
        )


def stiffness(u: fem.Function, v: Expr, du: Expr, data: ProblemData) -> Expr:
    """``a(du, v) + J''(u)(v, du)``, with J = 0 unless the user gives an energy."""
    form = elastic_form(du, v, data)
    if data.own_energy is None:
        return form
    return form + ufl.derivative(own_forces(u, v, data), u, du)


def own_forces(u: fem.Function, v: Expr, data: ProblemData) -> Expr:
    """``J'(u) v`` for the user's own energy J, which the data must have."""
    assert data.own_energy is not None
    return ufl.derivative(data.own_energy(u), u, v)
