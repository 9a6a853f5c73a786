"""How far a penalised solution is from the inequality's on the same mesh.

For the friction bound G frozen at that of the solution, both solve convex problems, and what a
penalised solution leaves behind bounds the distance: its stress and tractions are admissible for
the dual of the inequality's problem, and a field near it is admissible for the primal one.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from contact_locking.certificate.elliptic import NotApplicable
from contact_locking.certificate.lifting import Lifting
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.laws.convex import squared_norm
from contact_locking.laws.elasticity import strain
from contact_locking.problem import compiled, forms
from contact_locking.problem.forms import ProblemData
from contact_locking.results.derived import integral

FloatArray = npt.NDArray[np.float64]

# Rounding left when the penetration is taken back, relative to the body.
_ROUNDING = 1e-10


def penalty_error(state: SolvedState, lifting: Lifting) -> dict[str, Any]:
    """``a(u - u*, u - u*)/2 <= eta^2``, where u* solves (19) on this mesh with the bound G frozen.

    For an admissible field ``w`` (``|eps(w)| <= M``, ``w_nu <= gap``), with the solution's own Z, p
    and ``t = -sigma_tau``,

        eta^2 = a(w - u, w - u)/2 + int (M |Z| - Z : eps(w)) + int p (gap - w_nu)
                + int (G |w_tau| - t . w_tau),

    every term of which is non-negative: it is the primal energy of w minus the dual energy of
    (Z, p, t), to which u is the displacement in equilibrium (docs/certificate.md).

    ``w`` is u with its penetration taken back by an elastic field and then drawn towards an
    admissible field until the strain keeps its limit.  Returns ``energy_norm``
    (bounds ``sqrt(a(u - u*, u - u*))``), ``relative`` to that of u, and ``displacement_norm``
    (bounds ``|u - u*|_V``), or None with a ``reason``.  Collective; one factorisation.
    """
    target = state.target
    if target.penalty.is_inequality:
        return {"energy_norm": 0.0, "relative": 0.0, "displacement_norm": 0.0}
    try:
        if not state.report.converged:
            raise NotApplicable("the solve did not converge")
        w = _admissible_neighbour(state, lifting)
    except NotApplicable as failure:
        none = dict.fromkeys(("energy_norm", "relative", "displacement_norm"))
        return {**none, "reason": str(failure)}
    square = 2.0 * _gap(state, w)
    size = np.sqrt(2.0 * state.energy)
    return {
        "energy_norm": float(np.sqrt(square)),
        "relative": float(np.sqrt(square) / size) if size > 0.0 else None,
        "displacement_norm": float(np.sqrt(square / state.problem.material.ellipticity)),
    }


def distance(u: fem.Function, other: fem.Function, data: ProblemData) -> dict[str, float]:
    """Two displacements on one mesh: ``energy_norm``, ``relative`` to u and ``displacement_norm``.

    Raises ValueError if their meshes are not distributed alike.  Collective.
    """
    mesh = u.function_space.mesh
    comm = mesh.comm
    here, there = mesh.geometry.x, other.function_space.mesh.geometry.x
    if not comm.allreduce(here.shape == there.shape and np.array_equal(here, there), op=MPI.LAND):
        raise ValueError("the two displacements do not live on the same mesh")
    difference = fem.Function(u.function_space)
    difference.x.array[:] = u.x.array - other.x.array

    def total(form: Any) -> float:
        return float(np.sqrt(comm.allreduce(fem.assemble_scalar(compiled.form(form)))))

    energy = total(forms.elastic_form(difference, difference, data))
    size = total(forms.elastic_form(u, u, data))
    return {
        "energy_norm": energy,
        "relative": energy / size if size > 0.0 else energy,
        "displacement_norm": total(squared_norm(strain(difference)) * data.dx),
    }


def _admissible_neighbour(state: SolvedState, lifting: Lifting) -> fem.Function:
    """``w = w_0 + theta (u - c - w_0)`` with the largest theta that keeps the strain's limit."""
    start, back = lifting.admissible, lifting.push_back()
    w = fem.Function(back.function_space)
    w.x.array[:] = state.problem.u.x.array - back.x.array
    _check_entered(state, w)
    a = np.zeros_like(state.points.strain)
    if start is not None:
        a = state.points.interpolated(strain(start))
    theta = _largest_step(a, state.points.interpolated(strain(w)) - a, state.points.limit)
    theta = float(state.problem.domain.comm.allreduce(theta, op=MPI.MIN))
    w.x.array[:] *= theta
    if start is not None:
        w.x.array[:] += (1.0 - theta) * start.x.array
    return w


def _largest_step(a: FloatArray, b: FloatArray, limit: FloatArray) -> float:
    """The largest theta in [0, 1] with ``|a + theta b| <= M`` at all points, where ``|a| <= M``."""
    locks = np.isfinite(limit)
    a, b, limit = a[locks], b[locks], limit[locks]
    aa, ab, bb = (np.einsum("kij,kij->k", *pair) for pair in ((a, a), (a, b), (b, b)))
    room = np.maximum(limit**2 - aa, 0.0)
    # The positive root of bb theta^2 + 2 ab theta = room, without cancellation.
    root = np.sqrt(ab**2 + bb * room)
    bottom = np.where(ab > 0.0, ab + root, bb)
    top = np.where(ab > 0.0, room, root - ab)
    steps = np.divide(top, bottom, out=np.ones_like(top), where=bottom > 0.0)
    return float(min(1.0, steps.min(initial=1.0)))


def _check_entered(state: SolvedState, w: fem.Function) -> None:
    local = 0.0
    for fields in state.contacts:
        local = max(local, float(np.max(fields.contact.split(w)[0] - fields.gap, initial=0.0)))
    largest = state.problem.domain.comm.allreduce(local, op=MPI.MAX)
    if largest > _ROUNDING * state.target.length:
        raise NotApplicable("displacements prescribed on the edge of Gamma_C enter the foundation")


def _gap(state: SolvedState, w: fem.Function) -> float:
    """eta^2."""
    u, data, points = state.problem.u, state.problem.data, state.points
    step = fem.Function(u.function_space)
    step.x.array[:] = w.x.array - u.x.array
    total = integral(state.problem.domain, 0.5 * forms.elastic_form(step, step, data))
    stress, eps = points.locking_stress, points.interpolated(strain(w))
    size = np.linalg.norm(stress, axis=(1, 2))
    largest = np.where(np.isfinite(points.limit), points.limit, 0.0) * size
    total += state.sum(points.weights * (largest - np.einsum("kij,kij->k", stress, eps)))
    for fields in state.contacts:
        normal, slip = fields.contact.split(w)
        work = np.sum(fields.traction * slip, axis=1)
        friction = fields.bound * np.linalg.norm(slip, axis=1) + work
        opening = fields.pressure * (fields.gap - normal)
        total += state.sum(fields.surface.weights * (opening + friction))
    return max(total, 0.0)
