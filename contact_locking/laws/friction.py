"""Coulomb friction under a known bound: the regularised friction functional.

The bound ``g = mu(|u_tau|) |R sigma_nu|`` is a coefficient here.  It depends on the solution, and
the outer fixed point (solver.fixed_point) makes the two agree; for a given bound the functional is
convex, which is what the solvers rely on.
"""

from __future__ import annotations

from ufl.core.expr import Expr

from contact_locking.laws.convex import regularised_norm


def friction_traction(u_tangential: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``g u_tau/sqrt(|u_tau|^2 + eps^2)``, so that ``sigma_tau`` is its negative (22).

    ``bound`` is a stress, ``regularisation`` is the length eps.
    """
    return bound * u_tangential / regularised_norm(u_tangential, regularisation)


def friction_energy(u_tangential: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``g sqrt(|u_tau|^2 + eps^2)`` (20), whose derivative is :func:`friction_traction`."""
    return bound * regularised_norm(u_tangential, regularisation)
