"""The jump of displacements between two sides of an interface, as the values that laws limit."""

from __future__ import annotations

import numpy as np
import ufl
from dolfinx import fem
from petsc4py import PETSc
from scipy.sparse import csr_matrix
from ufl.core.expr import Expr

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.fem.trace import PointValues, Trace, displacement_map


class JumpValues(PointValues):
    """``[u]_i = u_i - sum_k m_ik u_k`` at the k owned nodes i of side 1.

    ``rows`` (k, N) are the entries of the jump at each node, for all N blocks of the displacement
    space by their global numbers.  A row without entries is a node without a jump.  They may be set
    anew, collectively, where the sides slide along each other.  Each jump has a
    space of its own, whose functions and arguments have the jump as their values at the nodes:
    forms over Gamma_C are assembled in this space, and :class:`~.joint_forms.JointForm` carries
    them over to displacements.  The other arguments are those of :class:`PointValues`.  The
    constructor is collective.
    """

    def __init__(
        self,
        trace: Trace,
        scalars: fem.FunctionSpace,
        vectors: fem.FunctionSpace,
        nodes: IndexArray,
        blocks: IndexArray,
        rows: csr_matrix,
    ) -> None:
        super().__init__(trace, scalars, vectors.clone(), nodes, blocks)
        self._vectors = vectors
        self._join(rows)
        self._at_nodes, self._values = self._matrix.createVecLeft(), self._matrix.createVecRight()
        self._jumps: list[tuple[fem.Function, fem.Function]] = []

    def _join(self, rows: csr_matrix) -> None:
        self._rows, self._matrix = rows, displacement_map(rows, self._vectors)

    def join(self, rows: csr_matrix) -> None:
        """Take other entries (k, N); collective."""
        self._matrix.destroy()
        self._join(rows)

    @property
    def by_blocks(self) -> csr_matrix:
        return self._rows

    def of(self, v: Expr) -> Expr:
        """The jump of a function or an argument.

        The jump of a function is that at the last :meth:`refresh`.
        """
        if not isinstance(v, fem.Function):
            return ufl.Argument(self.space, v.number(), v.part())
        for given, jump in self._jumps:
            if given is v:
                return jump
        jump = fem.Function(self.space, name=v.name)
        self._jumps.append((v, jump))
        return jump

    def refresh(self) -> None:
        """Take the present values of all functions whose jump somebody has; collective."""
        for given, jump in self._jumps:
            jump.x.array[:] = 0.0
            nodes = self.blocks[self._nodes]
            jump.x.array.reshape(-1, *given.ufl_shape)[nodes] = self.at_nodes(given.x.array)
            jump.x.scatter_forward()

    def of_function(self, function: fem.Function) -> FloatArray:
        if function.ufl_shape == ():
            return super().of_function(function)
        return self.at_nodes(function.x.array)

    def at_nodes(self, values: FloatArray) -> FloatArray:
        self._values.array_w[:] = values[: self._values.getLocalSize()]
        self._matrix.mult(self._values, self._at_nodes)
        return np.array(
            self._at_nodes.array_r.reshape(len(self._nodes), self.space.dofmap.index_map_bs)
        )

    def carried(self, forces: FloatArray) -> FloatArray:
        """The forces at all local dofs of displacements for forces on the dofs of :attr:`space`.

        Collective.
        """
        size = self.space.dofmap.index_map_bs
        return self.forces(forces.reshape(-1, size)[self.blocks[self._nodes]])

    def forces(self, at_nodes: FloatArray) -> FloatArray:
        self._at_nodes.array_w[:] = at_nodes.reshape(-1)
        self._matrix.multTranspose(self._at_nodes, self._values)
        forces = fem.Function(self._vectors)
        forces.x.array[: self._values.getLocalSize()] = self._values.array_r
        forces.x.scatter_forward()
        return np.asarray(forces.x.array)

    def square(self, free: FloatArray) -> PETSc.Mat:
        """The map from displacements to their jump as functions of :attr:`space`; collective.

        It has the entries at the local dofs that ``free`` marks with 1; the caller destroys it.
        """
        index_map, size = self._vectors.dofmap.index_map, self._vectors.dofmap.index_map_bs
        own = self.blocks[self._nodes]
        ones = np.ones(len(own))
        shape = (index_map.size_local, len(own))
        place = csr_matrix((ones, (own, np.arange(len(own)))), shape=shape)
        matrix = displacement_map(place @ self._rows, self._vectors)
        mask = matrix.createVecRight()
        mask.array_w[:] = free[: index_map.size_local * size]
        matrix.diagonalScale(None, mask)
        mask.destroy()
        return matrix

    def destroy(self) -> None:
        for item in (self._matrix, self._at_nodes, self._values):
            item.destroy()
