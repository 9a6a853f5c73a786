"""Bounds that the theory proves, each beside its measured value."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import ufl
from dolfinx import fem

from contact_locking import forms
from contact_locking.certificate.elliptic import (
    NotApplicable,
    elasticity,
    elliptic_problem,
    inner_product,
    springs,
)
from contact_locking.certificate.lifting import Lifting
from contact_locking.certificate.state import SolvedState
from contact_locking.convex import normal_part, positive_part, squared_norm, unit_ball_excess
from contact_locking.material import strain
from contact_locking.results import integral

# Rounding and the solver's tolerance may put a measured value this share above its bound.
_SLACK = 1e-6


@dataclass(frozen=True)
class _Bounds:
    displacement_norm: float
    locking_penalty: float
    contact_penalty: float


def proved_bounds(state: SolvedState, lifting: Lifting) -> dict[str, dict[str, Any]]:
    """The a priori bounds of Lemma 4.5 iii and Theorem 4.9 a)-c) for the penalised solution.

    With ``v = u`` in (25), a gap >= 0 and homogeneous displacement conditions every term on the
    left is non-negative, ``a(u,u) >= alpha |u|_V^2``, and so

        |u|_V <= |f|_V/alpha,
        (1/eps) |[u_nu - gap]^+|^2 <= |f|_V^2/alpha,   2n |[|eps| - M]^+|^2 <= |f|_V^2/alpha.

    Displacements that are not zero and a negative gap enter through an admissible field ``w``
    without slip, tested with ``v = u - w`` (:func:`_held_bounds`); where contact alone holds a
    rigid motion the load is carried by a pressure on Gamma_C (:func:`_pressed_bounds`).

    Each entry holds ``value``, ``bound`` and ``holds``; where no bound is proved, ``bound`` and
    ``holds`` are None and ``reason`` says why.  Collective; one linear solve, two with ``w``.
    """
    values = _measured(state)
    try:
        w = lifting.admissible
        proved = _pressed_bounds(state, w) if state.problem.free else _held_bounds(state, w)
    except NotApplicable as failure:
        reason = str(failure)
        return {
            name: {"value": value, "bound": None, "holds": None, "reason": reason}
            for name, value in values.items()
        }
    found = {}
    for name, value in values.items():
        bound = getattr(proved, name)
        holds = bool(value <= bound * (1.0 + _SLACK))
        found[name] = {"value": value, "bound": bound, "holds": holds}
    return found


def _measured(state: SolvedState) -> dict[str, float]:
    """``|u|_V`` and the penalised violations of both constraints; these are no more for n = inf."""
    domain, data, u = state.problem.domain, state.problem.data, state.problem.u
    eps = strain(u)
    values = {"displacement_norm": norm(state, u)}
    if np.isfinite(state.target.n):
        excess = unit_ball_excess(eps, data.inverse_limit) ** 2 * squared_norm(eps)
        values["locking_penalty"] = 2.0 * state.target.n * integral(domain, excess * data.dx)
    if data.contact is not None and state.target.epsilon > 0.0:
        opening = normal_part(u, data.contact.normal) - data.contact.gap
        square = integral(domain, positive_part(opening) ** 2 * data.contact.ds)
        values["contact_penalty"] = square / state.target.epsilon
    return values


def norm(state: SolvedState, u: fem.Function) -> float:
    """``|u|_V = |eps(u)|`` in L2 (10); collective."""
    data = state.problem.data
    return float(np.sqrt(integral(state.problem.domain, squared_norm(strain(u)) * data.dx)))


def _held_bounds(state: SolvedState, w: fem.Function | None) -> _Bounds:
    """For a body that its displacement conditions hold.

    Tested with ``v = u - w``, R_n and contact still give at least their penalties, as
    ``|eps(w)| <= M`` and ``w_nu <= gap``, and friction is not negative, as ``w_tau = 0``.  So with
    ``(f_w, v) = (f, v) - a(w, v)``

        a(v, v) + 2n |[|eps| - M]^+|^2 + (1/eps) |[u_nu - gap]^+|^2 <= |f_w|_V |v|_V,

    hence ``|u|_V <= |w|_V + |f_w|_V/alpha``, and ``|f_w|_V^2/alpha`` for both penalties.
    """
    alpha = state.problem.material.ellipticity
    load = dual_norm(state, w)
    lift = 0.0 if w is None else norm(state, w)
    return _Bounds(lift + load / alpha, load**2 / alpha, load**2 / alpha)


def _pressed_bounds(state: SolvedState, w: fem.Function | None) -> _Bounds:
    """For a body that contact alone keeps from a rigid motion, so that ``|.|_V`` is no norm.

    Springs on Gamma_C carry the load: ``a(z, v) + int q v_nu = (f_w, v)`` for all v, with
    ``q = k z_nu``.  If they are all pressed, ``q >= 0``, then with ``v = u - w`` in (25) and
    ``v_nu <= gap - w_nu + [u_nu - gap]^+``, the penalties L of locking and C of contact obey

        a(v, v) + L + C <= a(z, v) + B + C/2,   B = int q (gap - w_nu) + eps/2 |q|^2,

    so ``|v|_V^2 <= (a(z, z) + 2B)/alpha``, ``L <= a(z, z)/4 + B`` and ``C <= a(z, z)/2 + 2B``.
    """
    if state.problem.sliding:
        raise NotApplicable("friction alone holds a rigid motion")
    data, domain = state.problem.data, state.problem.domain
    contact, alpha = data.contact, state.problem.material.ellipticity
    assert contact is not None and state.contact is not None
    surface = state.contact.surface
    stiffness = alpha / state.target.length
    bilinear = elasticity(state) + springs(state, stiffness)
    with elliptic_problem(state, bilinear, state.problem.constraints.conditions) as problem:
        z = problem.solve(_load(state, w))
    pressure = stiffness * surface.average(normal_part(z, contact.normal))()
    if domain.comm.allreduce(bool(np.any(pressure < 0.0))):
        raise NotApplicable(
            "contact alone holds a rigid motion, and the load is not carried by a pressure all "
            "over Gamma_C"
        )
    room = state.contact.gap
    if w is not None:
        room = room - surface.average(normal_part(w, contact.normal))()
    total = float(surface.integral(pressure * (room + 0.5 * state.target.epsilon * pressure)))
    energy = integral(domain, forms.elastic_form(z, z, data))
    lift = 0.0 if w is None else norm(state, w)
    return _Bounds(
        lift + float(np.sqrt((energy + 2.0 * total) / alpha)),
        0.25 * energy + total,
        0.5 * energy + 2.0 * total,
    )


def dual_norm(state: SolvedState, w: fem.Function | None = None) -> float:
    """``|f_w|_V = |z|_V`` with ``(z, v)_V = (f, v) - a(w, v)`` (10), (13); collective.

    The conditions on Gamma_D are taken as homogeneous.
    """
    space, data = state.problem.u.function_space, state.problem.data
    conditions = state.problem.constraints.conditions
    with elliptic_problem(state, inner_product(space, data.dx), conditions) as problem:
        return norm(state, problem.solve(_load(state, w)))


def _load(state: SolvedState, w: fem.Function | None) -> Any:
    """``(f, v) - a(w, v)``."""
    data, v = state.problem.data, ufl.TestFunction(state.problem.u.function_space)
    load = forms.external_work(v, data)
    return load if w is None else load - forms.elastic_form(w, v, data)
