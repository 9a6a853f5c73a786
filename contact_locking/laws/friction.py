"""Coulomb friction under a known bound: the regularised friction functional.

The friction bound ``G = mu(|u_tau|) |R sigma_nu|`` is a coefficient here, although it depends on
the solution: the fixed point (solver.fixed_point) updates the bound until both agree.  For a given
bound the functional is convex, and the solvers rely on this.
"""

from __future__ import annotations

from ufl.core.expr import Expr

from contact_locking.laws.convex import regularised_norm


def friction_traction(u_tangential: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``-sigma_tau = G u_tau/sqrt(|u_tau|^2 + eps^2)`` (22).

    ``bound`` is the stress G, and ``regularisation`` is the length eps.
    """
    return bound * u_tangential / regularised_norm(u_tangential, regularisation)


def friction_energy(u_tangential: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``G sqrt(|u_tau|^2 + eps^2)`` (20), whose derivative is :func:`friction_traction`."""
    return bound * regularised_norm(u_tangential, regularisation)
