"""The distance of a penalised solution from the solution of the inequality on the same mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.certificate.elliptic import Lifting, NotApplicable, require_still_foundations
from contact_locking.certificate.solved_state import SetAtPoints, SolvedState
from contact_locking.parallel import maximum, minimum

# The rounding in w_nu - gap after the penetration is subtracted, relative to the body.
_ROUNDING = 1e-10


def penalty_error(state: SolvedState, lifting: Lifting) -> dict[str, Any]:
    """``a(u - u*, u - u*)/2 <= eta^2``, where u* solves (19) on this mesh with G kept fixed.

    For an admissible field w (``|eps(w)| <= M``, ``w_nu <= gap``), and with Z, p and
    ``t = -sigma_tau`` of the penalised solution u, summed over all sets of strains,

        eta^2 = a(w - u, w - u)/2 + int (M |Z| - Z : eps(w)) + int p (gap - w_nu)
                + int (G |w_tau - u_old| - t . (w_tau - u_old)).

    The proof, and how w is found, are in docs/notes/bounds.md.  Returns ``energy_norm``, a bound of
    ``sqrt(a(u - u*, u - u*))``; ``relative``, this bound over the energy norm of u; and
    ``displacement_norm``, a bound of ``|u - u*|_V``; or None with a ``reason``.  Collective; takes
    one factorisation.
    """
    target = state.target
    if target.penalty.is_inequality:
        return {"energy_norm": 0.0, "relative": 0.0, "displacement_norm": 0.0}
    try:
        if not state.report.converged:
            raise NotApplicable("the solve did not converge")
        require_still_foundations(state)
        w = admissible_neighbour(state, lifting)
    except NotApplicable as failure:
        none = dict.fromkeys(("energy_norm", "relative", "displacement_norm"))
        return {**none, "reason": str(failure)}
    found = float(np.sqrt(2.0 * _gap(state, w)))
    return {
        "energy_norm": found,
        "relative": state.relative(found),
        "displacement_norm": found / float(np.sqrt(state.problem.material.ellipticity)),
    }


def admissible_neighbour(state: SolvedState, lifting: Lifting) -> fem.Function:
    """``w = w_0 + theta (u - c - w_0)`` with the largest theta in [0, 1] and ``|eps(w)| <= M``.

    Collective.  Raises NotApplicable if there is no such field.
    """
    start, back = lifting.admissible, lifting.push_back()
    w = fem.Function(back.function_space)
    w.x.array[:] = state.problem.u.x.array - back.x.array
    enters = [float(np.max(f.contact.split(w)[0] - f.gap, initial=0.0)) for f in state.contacts]
    if maximum(state.comm, max(enters, default=0.0)) > _ROUNDING * state.target.length:
        raise NotApplicable("prescribed displacements at the edge of Gamma_C enter the foundation")
    theta = 1.0
    for item in state.points.sets:
        b = item.measured(w)
        a = np.zeros_like(b) if start is None else item.measured(start)
        theta = min(theta, _longest_step(item, a, b - a))
    theta = minimum(state.comm, theta)
    w.x.array[:] *= theta
    if start is not None:
        w.x.array[:] += (1.0 - theta) * start.x.array
    return w


def energy_distance(state: SolvedState, w: fem.Function) -> float:
    """``sqrt(a(w - u, w - u))`` for the displacement u of the state; collective."""
    u = state.problem.u
    step = fem.Function(u.function_space)
    step.x.array[:] = w.x.array - u.x.array
    return float(np.sqrt(2.0 * state.system.forms.energy(step)))


def _longest_step(item: SetAtPoints, a: FloatArray, b: FloatArray) -> float:
    """The largest theta in [0, 1] with ``a + theta b`` in the set at all points, as a is."""
    locks = np.isfinite(item.limit)
    a, b, limit = a[locks], b[locks], item.limit[locks]
    if a.ndim == 1:
        room = np.maximum(limit - a, 0.0)
        steps = np.divide(room, b, out=np.ones_like(b), where=b > 0.0)
        return float(min(1.0, steps.min(initial=1.0)))
    aa, ab, bb = (np.einsum("kij,kij->k", *pair) for pair in ((a, a), (a, b), (b, b)))
    room = np.maximum(limit**2 - aa, 0.0)
    # The positive root of bb theta^2 + 2 ab theta = room, without cancellation.
    root = np.sqrt(ab**2 + bb * room)
    bottom = np.where(ab > 0.0, ab + root, bb)
    top = np.where(ab > 0.0, room, root - ab)
    steps = np.divide(top, bottom, out=np.ones_like(top), where=bottom > 0.0)
    return float(min(1.0, steps.min(initial=1.0)))


def _gap(state: SolvedState, w: fem.Function) -> float:
    """``eta^2`` of :func:`penalty_error`; collective."""
    points = state.points
    total = 0.5 * energy_distance(state, w) ** 2
    for item in points.sets:
        work = item.work(item.measured(w))
        total += state.sum(points.weights * (item.support - work))
    for fields in state.contacts:
        normal, slip = fields.contact.split(w)[0], fields.contact.increment(w)
        work = np.sum(fields.traction * slip, axis=1)
        friction = fields.bound * np.linalg.norm(slip, axis=1) + work
        opening = fields.pressure * (fields.gap - normal)
        total += state.sum(fields.surface.weights * (opening + friction))
    return max(total, 0.0)
