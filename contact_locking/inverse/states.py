"""Which points are near a change of their state, where derivatives are those of one side only.

At a point of a cone one of the two, the point or its multiplier, is away from the end of its cone:
a gap is open or a pressure acts, a strain is below its limit or a locking stress acts, a slip is
there or friction is below its bound.  Where both are at the end, as where a body just touches, the
state changes with the data, and the two sides of the change have derivatives of their own.

Points of the central path are inside of their cones.  One whose room, times the stiffness of the
body, is not small beside its force, nor large, is near a change as well: its state is not told.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.parallel import maximum
from contact_locking.solver.interior_point.contact_cones import ContactCones
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.friction_cones import FrictionCones
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
from contact_locking.solver.interior_point.lorentz import norm

# A point is near a change where both are below this share of the largest, or of the limit.
_NEAR = 1e-3
# The state of a point is told where room and force, in units of the body, are so far apart.
_TOLD = 1e-4


def share_at_change(
    families: Sequence[Family], young: float, comm: MPI.Intracomm
) -> dict[str, float]:
    """The share of the points of "strain", "contact" and "friction" near a change; collective.

    ``young`` is the modulus of the body.
    """
    counts: dict[str, FloatArray] = {}
    for family in families:
        kind, near = _judged(family, young / family.scale, comm)
        size = np.array([family.weights[near].sum(), family.weights.sum()])
        counts[kind] = counts.get(kind, np.zeros(2)) + comm.allreduce(size)
    return {
        kind: float(near / every) if every > 0.0 else 0.0 for kind, (near, every) in counts.items()
    }


def _judged(family: Family, stiffness: float, comm: MPI.Intracomm) -> tuple[str, BoolArray]:
    """The kind of a family, and its points near a change; collective."""
    if isinstance(family, FrictionCones):
        if not family.takes_part:
            return "friction", np.zeros(len(family.weights), dtype=bool)
        slip, bound = norm(family.x[1:]), family.bound
        left = bound - norm(family.z[1:])
        holds = bound > _NEAR * maximum(comm, bound)
        near = (slip <= _NEAR * maximum(comm, slip)) & (left <= _NEAR * bound)
        return "friction", np.asarray(holds & (near | _untold(stiffness * slip, left)))
    if not family.takes_part:
        return _at_rest(family, comm)
    if family.x.ndim == 1:
        room, force = family.x, family.z
        size = maximum(comm, np.abs(family.seen))
    else:
        room, force = family.x[0] - norm(family.x[1:]), family.z[0]
        size = family.x[0]
    near = (room <= _NEAR * size) & (force <= _NEAR * maximum(comm, force))
    near |= _untold(stiffness * room, force)
    return "contact" if isinstance(family, ContactCones) else "strain", np.asarray(near)


def _untold(room: FloatArray, force: FloatArray) -> BoolArray:
    """Where neither of two stresses is small beside the other."""
    return np.asarray(np.minimum(room, force) > _TOLD * np.maximum(room, force))


def _at_rest(family: Family, comm: MPI.Intracomm) -> tuple[str, BoolArray]:
    """The points of cones that take no part in an elastic solution: those that are nearly reached.

    Its multipliers are zero.
    """
    if isinstance(family, ContactCones):
        room = family.limit - family.seen
        size = maximum(comm, np.concatenate([np.abs(family.seen), np.zeros(1)]))
        return "contact", np.asarray(room <= _NEAR * size)
    assert isinstance(family, LimitsOfStrain)
    return "strain", np.asarray(family.limit - family.reach <= _NEAR * family.limit)
