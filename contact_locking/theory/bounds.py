"""What the theory proves about a solved state, and the bounds with the measured values."""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.certificate.penalty_error import (
    EllipticProblem,
    Lifting,
    NotApplicable,
    require_still_foundations,
)
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import Proofs
from contact_locking.fem import compiled
from contact_locking.parallel import maximum
from contact_locking.problem.rounding import ROUNDING
from contact_locking.results.output import Extras
from contact_locking.theory.constants import (
    constant_supports,
    constants,
    inner_product,
    require_held,
)
from contact_locking.theory.search import critical_friction


def proofs(state: SolvedState, lifting: Lifting, extras: Extras) -> Proofs:
    """The a priori bounds, constants, and the parts that ``extras`` asks for; collective."""
    bounds = proved_bounds(state, lifting)
    entries: dict[str, Any] = {"bounds": bounds}
    errors: dict[str, Any] = {}
    reason = ""
    if extras.error_bound:
        # With the parts of SciPy that they use, these proofs take a while to import.
        from contact_locking.theory.energy_bound import guaranteed_error, limit_load

        limit = limit_load(state)
        entries |= {} if limit is None else {"limit_load": limit}
        if limit is not None and limit["infeasible"]:
            most = f"{100.0 * limit['load_factor'][1]:.3g}"
            reason = f"on no mesh can more than {most} % of them be followed"
        errors["guaranteed"] = guaranteed_error(state, lifting)
    entries["constants"] = constants(state, extras.constants)
    if extras.critical_friction:
        entries["critical_friction"] = critical_friction(state)
    broken = [
        f"the proved bound of {name.replace('_', ' ')} does not hold: {entry['value']:.3g} "
        f"exceeds {entry['bound']:.3g}"
        for name, entry in bounds.items()
        if entry["holds"] is False
    ]
    warnings = constant_supports(state) if extras.constants else ()
    return Proofs(entries, errors, "; ".join(broken), reason, warnings)


# Rounding and the solver's tolerance may put a measured value this share above its bound.
_SLACK = 1e-6


def proved_bounds(state: SolvedState, lifting: Lifting) -> dict[str, dict[str, Any]]:
    """The a priori bounds of Lemma 4.5 iii and Theorem 4.9 a)-c), with their sharp constants.

    They bound ``|u|_V``, ``int M |Z|``, ``|Z|^2/2n`` and ``eps |p|^2``, as sums over all sets of
    strains.  The proofs in docs/notes/bounds.md test with ``v = u - w`` for an admissible field w
    without slip.

    Each entry holds ``value``, ``bound`` and ``holds``.  If no bound is proved, ``bound`` and
    ``holds`` are None, and ``reason`` says why.  Collective; takes one linear solve, two with
    ``w``.  There is none where contact alone holds a rigid motion: ``|.|_V`` is no norm then.
    """
    values = _measured(state)
    try:
        require_still_foundations(state)
        require_held(state)
        proved = _held_bounds(state, lifting.admissible)
    except NotApplicable as failure:
        return {name: _open(value, str(failure)) for name, value in values.items()}
    entries, rounding = {}, _rounding(state)
    for name, value in values.items():
        bound = proved[name]
        if np.isfinite(bound):
            holds = bool(value <= bound * (1.0 + _SLACK) + rounding[name])
            entries[name] = {"value": value, "bound": bound, "holds": holds}
        else:
            entries[name] = _open(value, "no admissible strain below the locking limit was found")
    return entries


def _named(displacement: float, penalty: float, work: float) -> dict[str, float]:
    """Numbers for ``|u|_V``, the penalties of locking and contact, and ``int M |Z|``."""
    names = ("displacement_norm", "locking_penalty", "contact_penalty", "locking_work")
    return dict(zip(names, (displacement, penalty, penalty, work), strict=True))


def _rounding(state: SolvedState) -> dict[str, float]:
    """The rounding of each value, from that of the displacement, by strains and by the penalty.

    A body that nothing strains is judged by its gaps and its limits: else a bound of zero would be
    kept, or broken, by the rounding of a rounding.
    """
    alpha, epsilon = state.problem.material.ellipticity, state.target.penalty.epsilon
    length, points = state.target.length, state.points
    moved = state.largest_displacement
    for fields in state.contacts:
        moved = max(moved, min(maximum(state.comm, np.abs(fields.gap)), length))
    for strains in points.sets:
        limited = strains.limit[np.isfinite(strains.limit)]
        moved = max(moved, length * maximum(state.comm, np.minimum(limited, 1.0)))
    strain = ROUNDING * moved / length
    if state.contacts and epsilon > 0.0:
        strain += ROUNDING * moved / (epsilon * alpha)
    size = strain * float(np.sqrt(points.volume))
    return _named(size, alpha * size**2, alpha * size**2)


def _open(value: float, reason: str) -> dict[str, Any]:
    return {"value": value, "bound": None, "holds": None, "reason": reason}


def _measured(state: SolvedState) -> dict[str, float]:
    """``|u|_V``, ``int M |Z|``, and the penalties unless n = inf or eps = 0; collective."""
    data, u = state.problem.data, state.problem.u
    values = {"displacement_norm": state.system.forms.strain_norm(u)}
    penalty = state.target.penalty
    if np.isfinite(penalty.n):

        def compile_excess() -> fem.Form:
            excess = sum(law.energy(data.strain(u), 1.0) for law in data.sets)
            return compiled.form(excess * data.locking_dx)

        excess = fem.assemble_scalar(state.system.kept("excess", compile_excess))
        values["locking_penalty"] = 2.0 * penalty.n * float(state.comm.allreduce(excess))
    if state.contacts and penalty.epsilon > 0.0:
        entered = [np.maximum(fields.u_normal - fields.gap, 0.0) for fields in state.contacts]
        pairs = zip(state.contacts, entered, strict=True)
        square = sum(float(fields.surface.integral(depth**2)) for fields, depth in pairs)
        values["contact_penalty"] = square / penalty.epsilon
    values["locking_work"] = sum(
        state.sum(state.points.weights * strains.support) for strains in state.points.sets
    )
    return values


def _held_bounds(state: SolvedState, w: fem.Function | None) -> dict[str, float]:
    """The bounds, with an admissible field w or None for zero.

    Friction does the work ``-F`` at least (:func:`_remembered`); docs/notes/bounds.md has F = 0.
    """
    alpha = state.problem.material.ellipticity
    load, friction = dual_norm(state, w), _remembered(state)
    lift = 0.0 if w is None else state.system.forms.strain_norm(w)
    half = 0.5 * load / alpha
    largest = half + float(np.sqrt(half**2 + friction / alpha))
    most = 0.25 * load**2 / alpha + friction
    return _named(lift + largest, most, _locking_work(state, w, most))


def _remembered(state: SolvedState) -> float:
    """``F = int G |u_{k-1,tau}|`` with the friction bound G of the state; collective.

    In step k friction does the work ``int t . (u_tau - u_{k-1,tau}) >= 0`` with ``|t| <= G``, and
    so at least ``-F`` against ``u_tau``.  F is zero in the first step and in the static problem.
    """
    return sum(
        float(fields.surface.integral(fields.bound * np.linalg.norm(place, axis=1)))
        for fields, place in ((f, f.contact.references) for f in state.contacts)
    )


def _locking_work(state: SolvedState, w: fem.Function | None, most: float) -> float:
    """``most/(1 - max |eps(w)|/M)`` over all sets of strains, infinite without room; collective."""
    ratios = [] if w is None else [s.reach(s.measured(w)) / s.limit for s in state.points.sets]
    room = 1.0 - max((maximum(state.comm, ratio) for ratio in ratios), default=0.0)
    return most / room if room > 0.0 else np.inf


def dual_norm(state: SolvedState, w: fem.Function | None = None) -> float:
    """``|f_w|_V = |z|_V`` with ``(z, v)_V = (f, v) - a(w, v)`` (10), (13); collective.

    The displacement conditions are homogeneous.
    """
    product, constraints = inner_product(state), state.problem.constraints
    with closing(EllipticProblem(state, product, constraints)) as problem:
        forms = state.system.forms
        load = forms.loads() if w is None else forms.loads() - forms.elastic_forces(w)
        return forms.strain_norm(problem.solve(load))
