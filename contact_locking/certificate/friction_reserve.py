"""How much of its friction a body that friction alone holds has left."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.problem.motions_at_contact import MotionsAtContact
from contact_locking.problem.parts import loose_fields
from contact_locking.supports.rigid_motions import sliding_motions

# Iterations for the motion that friction opposes most.
_ITERATIONS = 20
# A unit motion is at rest at a node where it moves by less.
_AT_REST = 1e-9


def share_against_sliding(state: SolvedState) -> float:
    """``max |int sigma_tau . c| / int G |c_tau|`` over the rigid motions c along the foundations.

    It is 1 where the body is about to slide away along c.  Points that slide to different sides, as
    the feet of an arch, hold each other, and the share is less.  0 without such a motion.
    Collective.
    """
    problem, data, comm = state.problem, state.problem.data, state.comm
    space = problem.u.function_space
    fields = loose_fields(problem.domain, space, data, problem.constraints)
    everywhere = np.ones(fields.shape[1], dtype=bool)
    tools = data.loose_tools
    normals, moves, forces, bounds = [np.zeros((0, len(fields) + len(tools)))], [], [], []
    for found in state.contacts:
        at_nodes = MotionsAtContact(found.contact, fields, everywhere, tools)
        normals += comm.allgather(at_nodes.normals)
        if not found.contact.friction.frictionless:
            tangents = at_nodes.tangents()
            weights = found.contact.surface.weights * found.free
            moves.append(tangents.reshape(len(weights), problem.domain.dim, tangents.shape[1]))
            forces.append(weights[:, None] * found.traction)
            bounds.append(weights * found.bound)
    along = sliding_motions(np.concatenate(normals))
    if not along.shape[1] or not moves:
        return 0.0
    slides = np.concatenate(moves) @ along
    force, bound = np.concatenate(forces), np.concatenate(bounds)
    work: FloatArray = comm.allreduce(np.einsum("kdj,kd->j", slides, force))
    share, speed = 0.0, np.ones(len(bound))
    # |c_tau| = |c_tau|^2 / |c_tau|, with the denominator of the motion before.
    for _ in range(_ITERATIONS):
        gram = np.einsum("kdi,kdj,k->ij", slides, slides, bound / speed)
        motion = np.linalg.lstsq(comm.allreduce(gram), work)[0]
        motion /= float(np.linalg.norm(motion)) or 1.0
        speed = np.maximum(np.linalg.norm(slides @ motion, axis=1), _AT_REST)
        most = float(comm.allreduce(bound @ speed))
        share = max(share, float(abs(work @ motion)) / most if most > 0.0 else 0.0)
    return share
