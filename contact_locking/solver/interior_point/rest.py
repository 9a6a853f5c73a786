"""Whether a body is at rest: whether its loads balance without any multiplier."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.parallel import on_every_rank
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.task import Task

# The rounding in a product of the stiffness matrix over the product of all magnitudes: the entries
# of the matrix, the displacement and the sum of some tens of products have half a unit of the last
# digit each, of random signs.  Residuals of rigid motions have been 4 units at most.
_ROUNDING = 16.0 * float(np.finfo(float).eps)


def rests(task: Task, tangent: Tangent) -> bool:
    """Whether nothing presses the body, and it has no strains but rounding; collective.

    A motion may have moved the body.  Then all multipliers are zero, and the scale of the
    iteration, which the forces of the start have made, is far too large for them.  A pressure that
    is small, but more than the rounding of the elastic forces, is no such case.
    """
    target, tolerance = task.target, task.settings.tolerance
    displacement = task.system.largest_displacement()
    strain = target.mean_strain(tangent.energy, displacement, tolerance)
    if strain > target.mean_strain(0.0, displacement, tolerance):
        return False
    keeps = all(family.is_kept(0.0, displacement) for family in tangent.families)
    if not on_every_rank(tangent.comm, keeps):
        return False
    rounding = _ROUNDING * size_of_summands(tangent.elasticity, task.system.rounding.anchored)
    return tangent.residual_norms([])[0] <= max(tolerance * tangent.acting, rounding)


def size_of_summands(matrix: PETSc.Mat, displacement: FloatArray) -> float:
    """The norm of ``|K| |u|`` for the local values of u; collective."""
    starts, columns, entries = matrix.getValuesCSR()
    sizes = PETSc.Mat().createAIJ(
        matrix.getSizes(), csr=(starts, columns, np.abs(entries)), comm=matrix.comm
    )
    u, product = matrix.createVecs()
    u.array_w[:] = np.abs(displacement[: u.local_size])
    sizes.mult(u, product)
    norm = float(product.norm())
    for item in (sizes, u, product):
        item.destroy()
    return norm
