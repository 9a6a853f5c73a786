"""Coulomb friction under a known bound: the regularised friction functional.

The friction bound ``G = mu(s) |R sigma_nu|`` is a coefficient here, although it depends on the
solution: the fixed point (solver.fixed_point) updates the bound until both agree.  For a given
bound the functional is convex, and the solvers rely on this.  ``slip`` is ``u_tau`` in the static
problem, and ``u_tau - u_{k-1,tau}`` in step k of a process.
"""

from __future__ import annotations

from ufl.core.expr import Expr

from contact_locking.laws.convex import regularised_norm


def friction_traction(slip: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``-sigma_tau = G slip/sqrt(|slip|^2 + eps^2)`` (22).

    ``bound`` is the stress G, and ``regularisation`` is the length eps.
    """
    return bound * slip / regularised_norm(slip, regularisation)


def friction_energy(slip: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``G sqrt(|slip|^2 + eps^2)`` (20), whose derivative is :func:`friction_traction`."""
    return bound * regularised_norm(slip, regularisation)
