"""The elastic energy of an iterate, told from rounding."""

from __future__ import annotations

from petsc4py import PETSc

from contact_locking.problem.rounding import ROUNDING
from contact_locking.problem.system import PenalisedSystem


def energy_of(
    system: PenalisedSystem, displacement: PETSc.Vec, forces: PETSc.Vec, stiffest: float
) -> float:
    """``a(u, u)/2`` of the system's displacement with its elastic forces; collective.

    ``stiffest`` is a bound of the eigenvalues of the elasticity matrix.
    """
    energy = 0.5 * float(forces.dot(displacement))
    # The elastic forces at a body that moves far more than it is strained are small differences,
    # and the product multiplies their rounding by the whole motion.  The strains of its cells have
    # far less rounding, but to integrate them takes longer.
    rounding = ROUNDING * stiffest * float(displacement.dot(displacement))
    return energy if energy >= rounding else system.energy()
