"""Points on the central path, where the scaled tangent is the derivative of the iterate."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.parallel import maximum
from contact_locking.solver.interior_point.family import Family
from contact_locking.solver.interior_point.friction_cones import FrictionCones
from contact_locking.solver.interior_point.locking_cones import LockingCones
from contact_locking.solver.interior_point.lorentz import aligned
from contact_locking.solver.interior_point.principal_cones import PrincipalCones


def centred(family: Family, cones: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Points and multipliers (x, z) on the central path, near the given ones; collective.

    Off the path the scaling is no derivative: transverse to a strain at its limit it would be wrong
    by the root of the ratio of the two products of its cone.
    """
    if isinstance(family, FrictionCones):
        # Data that turn the normal of a foundation turn slips and tractions with it.
        cones = family.tangential(cones[0]), family.tangential(cones[1])
        slips, bounds = (values[0] / (maximum(family.comm, values[0]) or 1.0) for values in cones)
        return aligned(cones, slips >= bounds)
    if isinstance(family, LockingCones | PrincipalCones):
        return aligned(cones, np.ones(len(family.weights), dtype=bool))
    return cones
