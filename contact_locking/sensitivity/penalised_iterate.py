"""The iterate of a solution that Newton's method has found, by the penalty laws.

The laws are limits of central paths: with the product theta of a point and its multiplier,
``x o z = theta e`` and the compliances give a smooth law for each displacement, which differs from
the penalty law by a share of theta except at a kink.  So one tangent serves both methods.
"""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum
from contact_locking.problem.system import PenalisedSystem
from contact_locking.solver.interior_point.friction_cones import FrictionCones
from contact_locking.solver.interior_point.method import families_of
from contact_locking.solver.last_iterate import LastIterate
from contact_locking.solver.task import Target

# The product over the density of the elastic energy.
_PRODUCT = 1e-10
# No friction bound is a smaller share of the largest.
_LEAST_BOUND = 1e-12


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
