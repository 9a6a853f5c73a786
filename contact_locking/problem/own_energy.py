"""An energy of the user's own, checked before its forms are compiled."""

from __future__ import annotations

from collections.abc import Callable

import ufl
from dolfinx import fem
from ufl.algorithms import compute_form_data
from ufl.core.expr import Expr

from contact_locking.errors import InputError

# Up to this degree Basix has rules with few points on simplices; beyond it a rule for the degree q
# has ((q + 2)/2)^d points in each cell.
_LARGEST_DEGREE = 30


def check(energy: Callable[[fem.Function], Expr], space: fem.FunctionSpace) -> None:
    """Raise InputError for what is no energy, and for one that takes endless time to integrate.

    UFL estimates the degree of the quadrature, and each factor, each coefficient that varies in
    space and each function such as ``exp`` adds to it.
    """
    if not callable(energy) or isinstance(energy, Expr | ufl.Form):
        raise InputError(
            "must be a function of u that returns J(u), such as a form * ufl.dx", "energy"
        )
    u = fem.Function(space)
    form = energy(u)
    if not isinstance(form, ufl.Form) or form.arguments():
        raise InputError(
            "must return a form without arguments, the integral of a density: density * ufl.dx",
            "energy",
        )
    v, du = ufl.TestFunction(space), ufl.TrialFunction(space)
    tangent = ufl.derivative(ufl.derivative(form, u, v), u, du)
    degree = max(_degrees(tangent), default=0)
    if degree > _LARGEST_DEGREE:
        count = ((degree + 2) // 2) ** space.mesh.topology.dim
        raise InputError(
            f"UFL would integrate its second derivative with degree {degree}, so with some {count} "
            "points in each cell; give the integral a degree, such as ufl.dx(degree=2)",
            "energy",
        )


def _degrees(form: ufl.Form) -> list[int]:
    """The degrees of quadrature that UFL estimates for integrals without a degree of their own."""
    data = compute_form_data(form, do_estimate_degrees=True)
    found = [item.metadata() for part in data.integral_data for item in part.integrals]
    return [
        item["estimated_polynomial_degree"]
        for item in found
        if item.get("quadrature_degree", -1) in (-1, "default")
    ]
