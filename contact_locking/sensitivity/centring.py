"""Newton steps that bring the last iterate of a solve to the central path, where it is smooth.

A solve ends where residuals and the duality gap are small.  The complementarity products of its
cones may then be a hundred times apart.  On the path ``x o z = theta e`` with one theta, the
iterate is a smooth function of the data; off it a point near a change of its state has a derivative
that belongs to another theta than that of its neighbours, and was up to 40 % off.
"""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum, minimum
from contact_locking.sensitivity.equations import Equations
from contact_locking.sensitivity.linearisation import Change, Linearisation
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.lorentz import dot
from contact_locking.solver.last_iterate import LastIterate

# Products within this share of their mean are alike.
_ALIKE = 0.02
# The share of the way to the end of a cone, and the shortest step that leads anywhere.
_SHARE, _SHORT = 0.9, 0.05


def nearer_the_path(linear: Linearisation) -> LastIterate | None:
    """The iterate after a step to the mean product; None where the products are alike; collective.

    None as well where the step leads out of the cones at once.
    """
    equations, comm = linear.equations, linear.equations.system.comm
    families = equations.families
    total = comm.allreduce(sum(family.total() for family in families))
    weight = comm.allreduce(sum(f.scale * float(f.weights.sum()) for f in families))
    if not weight > 0.0:
        return None
    mean = total / weight
    apart = np.concatenate([np.abs(_products(family) / mean - 1.0) for family in families])
    if maximum(comm, apart) <= _ALIKE:
        return None
    change = linear.centring(mean)
    longest = [f.longest_step_between(step, step, 0.0) for f, step in change.steps.items()]
    length = min(1.0, _SHARE * minimum(comm, np.array(longest)))
    return _after(length, change, equations) if length > _SHORT else None


def _products(family: Family) -> FloatArray:
    """The complementarity products (k,) per volume."""
    product = family.x * family.z if family.x.ndim == 1 else dot(family.x, family.z)
    return np.asarray(product / family.scale)


def _after(length: float, change: Change, equations: Equations) -> LastIterate:
    """The iterate after a step; collective."""
    system, owned = equations.system, len(equations.system.load)
    system.u.x.array[:owned] += length * change.displacement[:owned]
    system.u.x.scatter_forward()
    moves = change.displacement[owned:]
    pairs = zip(system.tools.travels, moves, strict=True)
    travels = tuple(float(travel + length * move) for travel, move in pairs)

    def cones(family: Family) -> tuple[FloatArray, FloatArray] | None:
        step = change.steps.get(family)
        if step is None:
            return None
        return family.x + length * step.primal, family.z + length * step.dual

    every = tuple(cones(family) for family in equations.every)
    return LastIterate(system.u.x.array.copy(), travels, every)
