"""Whether the data of a problem are still those of its solution."""

from __future__ import annotations

import numpy as np

from contact_locking.errors import InputError
from contact_locking.parallel import maximum
from contact_locking.problem.system import PenalisedSystem
from contact_locking.sensitivity.equations import Equations
from contact_locking.solver.interior_point.friction_cones import FrictionCones

# At the last iterate the equations hold to the tolerance of the solver, but for points near a
# change of their state, which were moved inside their cones.  Data that have changed since the
# solve leave more than this share of forces and points.  The smooth laws that stand for penalties
# leave more of the forces, too, near a kink of a law.
_POINTS, _FORCES = 1e-4, 1e-3


def require_solved(equations: Equations) -> None:
    """Raise InputError if the equations do not hold at their iterate; collective."""
    residual, system = equations.residual(), equations.system
    left = residual.free[: len(system.load)]
    force = float(np.sqrt(system.comm.allreduce(float(left @ left))))
    holds = force <= _FORCES * system.force_scale(1.0)
    moved = system.largest_displacement()
    target = equations.target
    stress = target.ellipticity * target.mean_strain(system.energy(), moved, 1.0)
    for family, gap in zip(equations.families, residual.gaps, strict=True):
        if isinstance(family, FrictionCones):
            # Slips under a bound that is nothing beside the stress are left open by the solver.
            gap = gap * np.minimum(1.0, family.bound / stress if stress > 0.0 else 0.0)
        size = maximum(system.comm, family.x, moved if family.stops_rigid_motions else 0.0)
        holds &= maximum(system.comm, np.abs(gap)) <= _POINTS * size
    if not holds:
        raise changed()


def require_settled(system: PenalisedSystem, tolerance: float) -> None:
    """Raise InputError if the penalty laws do not balance the forces; collective."""
    if system.relative_residual(tolerance) > _POINTS:
        raise changed()


def changed() -> InputError:
    """The error about data that have changed."""
    return InputError(
        "the data have changed since the solve: solve again, or ask for derivatives before the "
        "data change"
    )
