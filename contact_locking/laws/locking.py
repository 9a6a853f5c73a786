"""The locking law: the strain limit ``|eps| <= M`` and the penalty R_n."""

from __future__ import annotations

from ufl.core.expr import Expr

from contact_locking.laws.convex import squared_norm, unit_ball_excess


def locking_stress(eps: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``R_n(eps) = 2 n [|eps| - M]^+ eps/|eps| = 2 n (1 - 1/max(|eps|/M, 1)) eps`` (23).

    ``inverse_limit`` is ``1/M``, and 0 where the body does not lock; ``n`` has the unit of a
    stress. The result is a (d, d) tensor, exactly zero where ``|eps| <= M``.
    """
    return 2.0 * n * unit_ball_excess(eps, inverse_limit) * eps


def locking_energy(eps: Expr, inverse_limit: Expr, n: Expr) -> Expr:
    """``n ([|eps| - M]^+)^2``, the density whose derivative is :func:`locking_stress`."""
    return n * unit_ball_excess(eps, inverse_limit) ** 2 * squared_norm(eps)
