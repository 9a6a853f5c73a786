"""Unilateral contact with a rigid foundation: the normal penalty with a gap."""

from __future__ import annotations

from ufl.core.expr import Expr

from contact_locking.laws.convex import positive_part


def contact_pressure(u_normal: Expr, gap: Expr, epsilon: Expr) -> Expr:
    """``p = -sigma_nu = (1/eps) [u_nu - gap]^+`` (25).

    ``u_normal`` and ``gap`` are lengths, and ``epsilon`` is a length over a stress.
    """
    return positive_part(u_normal - gap) / epsilon


def contact_energy(u_normal: Expr, gap: Expr, epsilon: Expr) -> Expr:
    """``([u_nu - gap]^+)^2/(2 eps)``, whose derivative in u_nu is :func:`contact_pressure`."""
    return positive_part(u_normal - gap) ** 2 / (2.0 * epsilon)
