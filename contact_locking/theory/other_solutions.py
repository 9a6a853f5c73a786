"""Other solutions of a problem without friction: the rigid motions that change nothing.

Two solutions u and u + c of a convex problem have the same strain, as a(., .) is strictly convex in
it.  So c is a rigid motion of each part of the body, with a travel of each tool, that the
displacement conditions leave free.  Equilibrium, tested with c, is ``(f, c) = int p c_nu``, with
c_nu relative to the tools.  Both energies are the same, so that ``(f, c) = 0``, and where a
pressure p of u is positive, the contact stays closed:

    c_nu = 0 where p > 0,    c_nu <= gap - u_nu elsewhere.

Each such c leads to a solution: its energy is that of u.  So the solutions are u plus a polyhedron
in the few coefficients of the rigid motions, at n = inf and at a finite n alike.  The locking
stress Z and the pressure p at n = inf need not be unique even if u is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import block_diag

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.problem.motions import (
    MotionsAtContact,
    describe_motion,
    point,
    sliding_motions,
)
from contact_locking.results.contact_points import OPEN

UNIQUE = "covered by theory"
OTHERS = "not unique"
IF_CONVEX = "covered by theory if the user-defined energy is convex"
OWN_ENERGY = "not known: it depends on the user-defined energy"
NOT_SOLVED = "not known: the solve did not converge"
TOO_CLOSE = "not known: pressures within the accuracy of the solver decide"

# A pressure above this share of the largest stress is no rounding of the solver.
_PRESSED = 1e-6
# Motions below this share of the displacements, or of the gaps, are rounding.
_LEAST = 1e-6
# Gaps of more displacements than this are as good as none.
_FAR = 1e3
# A part whose coefficients are below this is at rest.
_ROUNDING = 1e-9
# Work of the loads below this share of that of their sizes is rounding.
_IDLE = 1e-13


def without_friction(state: SolvedState) -> dict[str, Any]:
    """The verdict on uniqueness of the displacement on this mesh, and why; collective."""
    if not state.report.converged:
        return {"verdict": NOT_SOLVED, "why": "there is no solution to judge"}
    has_energy, motions = state.problem.data.own_energy is not None, _FreeMotions(state)
    # A motion is excluded by pressures that are certain, and found in spite of all pressures.
    possible = motions.play(_PRESSED)
    if possible is None:
        why = "there is no friction, and no rigid motion is free: u is unique on this mesh"
        if state.target.penalty.is_inequality:
            why += "; the locking stress and the pressure need not be"
        return {"verdict": IF_CONVEX if has_energy else UNIQUE, "why": why}
    motion = motions.play(0.0)
    if has_energy or motion is None:
        why = f"perhaps a rigid motion is free: {possible}"
        return {"verdict": OWN_ENERGY if has_energy else TOO_CLOSE, "why": why}
    return {"verdict": OTHERS, "why": f"a rigid motion is free: {motion}"}


class _FreeMotions:
    """The m rigid motions of all parts and travels of tools that the displacement conditions allow.

    ``_rows`` (k, m) are their normal components, relative to the tools, at the nodes where contact
    acts, ``_room`` (k,) is ``gap - u_nu`` there, and ``_pressure`` (k,) is p, with 0 where the
    solver knows the contact to be open, and ``_work`` (m,) the work of the loads, 0 where it is
    rounding.  ``_coefficients`` (n, m) are those of the translations and
    rotations of one part after the other, and then the travels.  The constructor is collective.
    """

    def __init__(self, state: SolvedState) -> None:
        problem, comm = state.problem, state.comm
        self._tools, domain = problem.data.loose_tools, problem.domain
        free, fields = problem.rigidity.loose()
        self._part_names = domain.part_names
        self._coefficients = block_diag(*free, np.eye(len(self._tools)))
        self._box = domain.bounding_box
        count = self._coefficients.shape[1]
        rows, room, pressure = [np.zeros((0, count))], [np.zeros(0)], [np.zeros(0)]
        everywhere = np.ones(fields.shape[1], dtype=bool)
        for of_contact in state.contacts if count else ():
            at_nodes = MotionsAtContact(of_contact.contact, fields, everywhere, self._tools)
            pressed = np.where(of_contact.state == OPEN, 0.0, of_contact.pressure)
            rows += comm.allgather(at_nodes.normals[of_contact.free])
            room += comm.allgather((of_contact.gap - of_contact.u_normal)[of_contact.free])
            pressure += comm.allgather(pressed[of_contact.free])
        self._rows, self._pressure = np.concatenate(rows), np.concatenate(pressure)
        self._room = np.maximum(np.concatenate(room), 0.0)
        self._work = self._of_loads(state, fields)
        self._stress = max(state.mean_stress, float(self._pressure.max(initial=0.0)))
        gaps = float(self._room[np.isfinite(self._room)].max(initial=0.0))
        #: Displacements are compared with the first of these that is not zero.
        lengths = (state.largest_displacement, gaps, state.target.length)
        self._length = next(length for length in lengths if length > 0.0)

    def _of_loads(self, state: SolvedState, fields: FloatArray) -> FloatArray:
        """The work (m,) of loads and tools along the motions, of 1 at most; collective."""
        load = state.system.load
        # An eigenstrain does no work on rigid motions, and its forces may dwarf the loads.
        net = load + state.system.forms.eigenstrain_forces()[: len(load)]
        moved = fields[:, : len(load)]
        work, size = state.comm.allreduce(np.array([moved @ net, np.abs(moved) @ np.abs(load)]))
        forces = np.array([tool.force for tool in self._tools])
        work, size = np.append(work, forces), np.append(size, np.abs(forces))
        work = np.where(np.abs(work) > _IDLE * size, work, 0.0)
        return np.asarray(work / (np.abs(work).max(initial=0.0) or 1.0))

    def play(self, pressed: float) -> str | None:
        """The motion c that leads to another solution, in words, None if there is none.

        Contact stays closed where the pressure is above the share ``pressed`` of the stress.
        """
        closed = self._rows[self._pressure > pressed * self._stress]
        # A motion that is found moves against no load, however small this is beside the stress.
        idle = self._work[None] if pressed == 0.0 and self._work.any() else closed[:0]
        allowed = sliding_motions(np.vstack([closed, idle]))
        motion = self._farthest(allowed)
        if motion is None:
            return None
        parts, tools = len(self._part_names), len(self._tools)
        coefficients = self._coefficients @ motion
        of_parts = coefficients[: len(coefficients) - tools].reshape(parts, -1)
        sizes = np.linalg.norm(of_parts, axis=1)
        if not sizes.max(initial=0.0) > _ROUNDING:
            tool = self._tools[int(np.argmax(np.abs(coefficients[-tools:])))]
            return f"the tool on {', '.join(tool.contact.on)} along {point(tool.direction, 1.0)}"
        most = int(np.argmax(sizes))
        of_part = f"{self._part_names[most]}, " if parts > 1 else ""
        return f"{of_part}{describe_motion(of_parts[most], self._box)}"

    def _farthest(self, allowed: FloatArray) -> FloatArray | None:
        """The motion (m,) of the allowed ones (m, j) that goes farthest; None if all are rounding.

        The motions have a largest normal component of 1, in units of the length.
        """
        from scipy.optimize import linprog

        rows = self._rows @ allowed
        scale = np.abs(rows).max(axis=0, initial=0.0)
        scale = 1.0 / np.where(scale > 0.0, scale, 1.0)
        room = np.minimum(self._room / self._length, _FAR)
        best, most = None, _LEAST
        for aim in np.vstack([np.eye(len(scale)), -np.eye(len(scale))]):
            result = linprog(-aim, A_ub=rows * scale, b_ub=room, bounds=(-1, 1))
            if result.status == 0 and -result.fun > most:
                best, most = allowed @ (scale * result.x), -result.fun
        return best
