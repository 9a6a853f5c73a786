"""Contact, and Coulomb friction under a known bound: the regularised friction functional.

The friction bound ``G = mu(s) |R sigma_nu|`` is a coefficient here, although it depends on the
solution: the solvers update the bound until both agree.  For a given
bound the functional is convex, and the solvers rely on this.  ``slip`` is ``u_tau`` in the static
problem, and ``u_tau - u_{k-1,tau}`` in step k of a process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.laws.convex import positive_part, regularised_norm


def friction_traction(slip: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``-sigma_tau = G slip/sqrt(|slip|^2 + eps^2)`` (22).

    ``bound`` is the stress G, and ``regularisation`` is the length eps.
    """
    return bound * slip / regularised_norm(slip, regularisation)


def friction_energy(slip: Expr, bound: Expr, regularisation: Expr) -> Expr:
    """``G sqrt(|slip|^2 + eps^2)`` (20), whose derivative is :func:`friction_traction`."""
    return bound * regularised_norm(slip, regularisation)


def contact_pressure(u_normal: Expr, gap: Expr, epsilon: Expr) -> Expr:
    """``p = -sigma_nu = (1/eps) [u_nu - gap]^+`` (25).

    ``u_normal`` and ``gap`` are lengths, and ``epsilon`` is a length over a stress.
    """
    return positive_part(u_normal - gap) / epsilon


def contact_energy(u_normal: Expr, gap: Expr, epsilon: Expr) -> Expr:
    """``([u_nu - gap]^+)^2/(2 eps)``, whose derivative in u_nu is :func:`contact_pressure`."""
    return positive_part(u_normal - gap) ** 2 / (2.0 * epsilon)


Coefficient = Callable[[FloatArray, FloatArray], FloatArray]


@dataclass(frozen=True)
class FrictionLaw:
    """``mu(x, s) <= largest`` and ``|mu(x, s) - mu(x, t)| <= lipschitz |s - t|``, as (12) asks.

    ``coefficient`` maps points (k, d) and slips ``s = |u_tau|`` (k,) to ``mu`` (k,), or to one
    number.  ``largest`` is mu*, and ``lipschitz`` is L_mu, one over a length.  The certificate
    takes both constants as the law states them.  Where a constant is None, the certificate samples
    mu, which proves nothing.
    """

    coefficient: Coefficient
    largest: float | None = None
    lipschitz: float | None = None

    def __call__(self, points: FloatArray, slip: FloatArray) -> FloatArray:
        found = np.asarray(self.coefficient(points, slip), dtype=float)
        if found.shape not in ((), slip.shape):
            raise InputError(
                f"the coefficient of friction has values of the shape {found.shape} at "
                f"{len(slip)} points: it maps points (k, d) and slips (k,) to values (k,), as "
                "lambda x, s: 0.1 + 0.2*x[:, 0] does"
            )
        return np.broadcast_to(found, slip.shape)
