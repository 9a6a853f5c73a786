"""The equations of the paper in UFL, in its order and with its numbers.

They differ from the print in five points.

- The foundation has a gap g, which is 0 in the paper: ``u_nu <= g``.
- In a process friction acts on the slip of the step, ``u_tau - u_{k-1,tau}``, which in the static
  problem of the paper is ``u_tau``.
- The paper has one epsilon.  Here the compliance of contact in (25), a length over a stress, is
  ``epsilon``, and the length in (21) is ``delta``, by default ``E epsilon`` with Young's modulus.
- ``G = mu(|u_tau|) |R sigma_nu(u)|`` is a coefficient, the friction bound, as in Tresca's problem;
  :mod:`~contact_locking.penalty_method.method` updates it.  At a fixed G the left side of
  (25) is the derivative of a convex energy, and its tangent is symmetric.
- Integrals over Gamma_C are sums over the nodes, with the weights ``int phi_i``.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import ufl
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.fem import compiled
from contact_locking.laws.body import (
    locking_energy,
    locking_stress,
    normal_part,
    positive_part,
    squared_norm,
    tangential_part,
)
from contact_locking.laws.limits import Penalty
from contact_locking.problem import forms
from contact_locking.problem.strain_sets import NormSet
from contact_locking.problem.system import System
from contact_locking.solver.task import ContactForces, Multipliers


def psi(v: Expr, delta: Expr) -> Expr:
    """``Psi(v) = sqrt(|v|^2 + delta^2)`` (21), a smooth norm."""
    return ufl.sqrt(squared_norm(v) + delta**2)


class OnGammaC:
    """The coefficients of one contact in the equations, as functions on Gamma_C; collective.

    ``normal`` is nu, ``gap`` is g, ``memory`` is ``u_{k-1,tau}``, ``bound`` is G, and ``delta`` is
    the length in (21).
    """

    def __init__(self, contact: NodalContact) -> None:
        surface = contact.surface
        self.contact, self.ds = contact, surface.ds
        self.normal = surface.vector_function(contact.normals)
        self.gap = surface.scalar_function(contact.gaps)
        self.memory = surface.vector_function(contact.references)
        self.bound = surface.scalar_function(0.0 * contact.gaps)
        self.delta = fem.Constant(surface.domain.mesh, contact.regularisation)

    def penetration(self, v: Expr) -> Expr:
        """``[v_nu - g]^+``."""
        return positive_part(normal_part(v, self.normal) - self.gap)

    def slip(self, v: Expr) -> Expr:
        """``v_tau - u_{k-1,tau}``."""
        return tangential_part(v, self.normal) - self.memory


class Equations:
    """The forms of the paper for the data of a system, whose displacement is ``u``; collective.

    ``v``, ``w`` and ``du`` are functions or arguments of the space of displacements.
    """

    def __init__(self, system: System) -> None:
        mesh = system.u.function_space.mesh
        self.system, self.data = system, system.data
        self.contacts = [OnGammaC(contact) for contact in system.contacts]
        self.n, self.epsilon = fem.Constant(mesh, 1.0), fem.Constant(mesh, 1.0)

    def set_penalty(self, penalty: Penalty) -> None:
        """Set n, epsilon, and delta of each contact."""
        self.n.value, self.epsilon.value = penalty.n, penalty.epsilon
        for terms, delta in zip(self.contacts, penalty.regularisations, strict=True):
            terms.delta.value = delta

    # Section 2.2: the weak formulation.

    def a(self, u: Expr, v: Expr) -> ufl.Form:
        """``a(u, v) = int A eps(u) : eps(v)``, with springs on the boundary, if there are any."""
        return forms.elastic_form(u, v, self.data)

    def load(self, v: Expr) -> ufl.Form:
        """``(f, v) = int f_0 . v + int g . v`` (13)."""
        return forms.external_work(v, self.data)

    # Section 3.1: the penalty problem.

    def j(self, v: Expr) -> ufl.Form:
        """``j(u, v) = int G Psi(v_tau)`` (20), with the bound G of u."""
        return _sum(c.bound * psi(c.slip(v), c.delta) * c.ds for c in self.contacts)

    def dj(self, v: Expr, w: Expr) -> ufl.Form:
        """``<j'(u, v), w> = int G v_tau . w_tau / sqrt(|v_tau|^2 + delta^2)`` (22)."""
        return _sum(
            c.bound
            * ufl.inner(c.slip(v), tangential_part(w, c.normal))
            / psi(c.slip(v), c.delta)
            * c.ds
            for c in self.contacts
        )

    def locking(self, u: Expr, v: Expr) -> ufl.Form:
        """``(R_n(eps(u)), eps(v))``, ``R_n(t) = 2 n [|t| - M]^+ t/|t|`` (23)."""
        eps, one_over_m = self.data.strain, self.data.inverse_limit
        return ufl.inner(locking_stress(eps(u), one_over_m, self.n), eps(v)) * self.data.locking_dx

    def contact(self, u: Expr, v: Expr) -> ufl.Form:
        """``<(1/epsilon) [u_nu - g]^+, v_nu>`` (24)."""
        return _sum(
            c.penetration(u) / self.epsilon * normal_part(v, c.normal) * c.ds for c in self.contacts
        )

    def residual(self, u: fem.Function, v: Expr) -> ufl.Form:
        """The left side of (25) less its right side.

        In the space V^h of continuous, piecewise affine displacements (section 3.2) it is that of
        (26), where ``epsilon = 1/n``.
        """
        return self.a(u, v) + self.locking(u, v) + self.contact(u, v) + self.dj(u, v) - self.load(v)

    def tangent(self, u: fem.Function, v: Expr, du: Expr) -> ufl.Form:
        """The derivative of :meth:`residual` in the direction ``du``, at a fixed bound G."""
        return ufl.derivative(self.residual(u, v), u, du)

    def energy(self, u: Expr) -> ufl.Form:
        """The convex energy whose derivative is :meth:`residual`, with phi of Lemma 4.3 (2).

        ``a(u, u)/2 + int n ([|eps(u)| - M]^+)^2 + int ([u_nu - g]^+)^2/(2 epsilon) + j - (f, u)``.
        """
        eps, one_over_m = self.data.strain(u), self.data.inverse_limit
        phi = locking_energy(eps, one_over_m, self.n) * self.data.locking_dx
        pressed = _sum(c.penetration(u) ** 2 / (2.0 * self.epsilon) * c.ds for c in self.contacts)
        return 0.5 * self.a(u, u) + phi + pressed + self.j(u) - self.load(u)

    # Section 2.1, (6): the forces and the friction bound of a displacement.

    def pressure(self, contact: NodalContact) -> FloatArray:
        """``-sigma_nu = [u_nu - g]^+/epsilon`` (k,) at the nodes of a contact; collective."""
        depth = (contact.split(self.system.u)[0] - contact.gaps).clip(0.0)
        return contact.acting(depth / float(self.epsilon.value))

    def friction_bounds(self) -> list[FloatArray]:
        """``G = mu(|u_tau|) |R sigma_nu(u)|`` (k,) of each contact with friction; collective."""
        u = self.system.u
        return [c.friction_bound(u, self.pressure(c)) for c in self.system.rubbing]

    def multipliers(self) -> Multipliers:
        """``R_n(eps(u))`` (23), ``-sigma_nu`` and ``-sigma_tau`` (22); collective."""
        system, forces = self.system, []
        for terms in self.contacts:
            contact, pressure = terms.contact, self.pressure(terms.contact)
            slip = contact.increment(system.u)
            size = np.hypot(np.linalg.norm(slip, axis=1), float(terms.delta.value))
            friction = (system.bounds[contact] / size)[:, None] * slip
            forces.append(ContactForces(pressure, friction, pressure > 0.0))
        mesh = system.u.function_space.mesh
        result = Multipliers.none(self.data, system.kept, mesh, tuple(forces))
        ball = NormSet("strain", self.data.inverse_limit)
        stress = ball.multiplier(self.data.strain(system.u), self.n)
        total = result.locking_stress
        total.interpolate(compiled.interpolation(stress, total.function_space))
        total.x.scatter_forward()
        return result

    def refresh(self) -> None:
        """Take the friction bounds that the system holds; collective."""
        for terms in self.contacts:
            terms.bound.x.array[terms.contact.surface.nodes] = self.system.bounds[terms.contact]
            terms.bound.x.scatter_forward()


def _sum(terms: Iterable[ufl.Form]) -> ufl.Form:
    return sum(terms, ufl.Form([]))
