"""Iterates near the central path, on which an iterate is a smooth function of the data.

A solve ends where residuals and the duality gap are small.  The complementarity products of its
cones may then be a hundred times apart.  Off the path ``x o z = theta e`` with one theta, a point
near a change of its state has a derivative that belongs to another theta than that of its
neighbours, and was up to 40 % off.

The penalty laws are limits of central paths: with the product theta of a point and its multiplier,
``x o z = theta e`` and the compliances give a smooth law for each displacement, which differs from
the penalty law by a share of theta except at a kink.  So one tangent serves both methods.
"""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.inverse.equations import Equations
from contact_locking.inverse.linearisation import Change, Linearisation
from contact_locking.parallel import maximum, minimum
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.families import families_of
from contact_locking.solver.interior_point.family import Family, dot
from contact_locking.solver.interior_point.friction_cones import FrictionCones
from contact_locking.solver.task import LastIterate, Target

# Products within this share of their mean are alike.
_ALIKE = 0.02
# The share of the way to the end of a cone, and the shortest step that leads anywhere.
_SHARE, _SHORT = 0.9, 0.05
# The product over the density of the elastic energy.
_PRODUCT = 1e-10
# No friction bound is a smaller share of the largest.
_LEAST_BOUND = 1e-12


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
    longest = [family.longest_step(step) for family, step in change.steps.items()]
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


def penalised_iterate(system: PenalisedSystem, target: Target, tolerance: float) -> LastIterate:
    """The displacement of the system with the cones that its laws give; collective."""
    strain = target.mean_strain(system.energy(), system.largest_displacement(), tolerance)
    product = _PRODUCT * target.ellipticity * strain**2
    families, owned = families_of(system, target, 0.0), len(system.load)
    displacement = np.append(system.u.x.array[:owned], np.zeros(len(system.tools)))
    cones: list[tuple[FloatArray, FloatArray] | None] = []
    for family in families.every:
        family.look(displacement)
        if isinstance(family, FrictionCones):
            bound = family.nodes.of_all(system.bounds[family.nodes.contact])
            largest = maximum(system.comm, bound)
            if largest == 0.0:
                cones.append(None)
                continue
            family.z[0] = np.maximum(bound, _LEAST_BOUND * largest)
        family.settle(product * family.scale)
        cones.append((family.x, family.z))
    families.destroy()
    return LastIterate(system.u.x.array.copy(), system.tools.travels, tuple(cones))
