"""The displacement conditions: components at nodes, and supports along other directions."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import AXES, BoolArray, FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem.compiled import JointForm
from contact_locking.fem.contact_operator import PointStiffness
from contact_locking.fem.fields import Clock
from contact_locking.mesh.domain import Domain, axis_dofs
from contact_locking.parallel import agree, maximum, minimum, on_any_rank
from contact_locking.supports.support import Displacement, Support
from contact_locking.supports.supports import (
    SAME,
    SMOOTH,
    PlacedSupport,
    placed_supports,
    pseudo_inverse,
)

# The sine of the angle below which two directions are too close for both to be held.
_TOO_CLOSE = 1e-2
# Two conditions for one direction agree up to this share of the largest prescribed value.
_AGREES = 1e-9


def block_diagonal(blocks: FloatArray, comm: Any) -> PETSc.Mat:
    """The matrix with blocks (k, d, d) of the nodes of each rank on its diagonal; collective."""
    count, dim = blocks.shape[:2]
    matrix = PETSc.Mat().create(comm)
    matrix.setSizes(((dim * count, None), (dim * count, None)), bsize=dim)
    matrix.setType(PETSc.Mat.Type.AIJ)
    first, _ = matrix.getOwnershipRange()
    starts = dim * np.arange(dim * count + 1, dtype=PETSc.IntType)
    of_node = first + np.arange(dim * count, dtype=PETSc.IntType).reshape(count, 1, dim)
    columns = np.repeat(of_node, dim, axis=1).reshape(-1)
    matrix.setPreallocationCSR((starts, columns, np.ascontiguousarray(blocks).reshape(-1)))
    matrix.assemble()
    return matrix


class HeldDirections:
    """The directions that are held at some nodes, with the displacements that they prescribe.

    At a node with the held directions m_1, ..., m_r (unit vectors, orthonormalised) let
    ``H = sum m_i m_i^T`` and ``P = I - H``, and let g be the displacement in the span of the
    directions that has the prescribed components.  Then ``u = P u + g``.  With the P of all nodes,
    the free part of a residual r is ``P r``, and the tangent A is replaced by ``P A P + s H`` with
    a stiffness s > 0 at each node, which is symmetric and, on the free displacements, the tangent
    itself.  For a direction along an axis these are the usual zero rows and columns with s on the
    diagonal.  Rounding in ``P A P`` couples the held directions with the free ones by a share of
    the stiffness of the node, which grows without bound where the node sticks to a foundation.  So
    s is the stiffness of the node itself.

    ``nodes`` (k,) are local nodes (blocks of the displacement space), ghosts included, of which the
    rank owns those below ``owned``.  ``held`` (k, d, d) are the projections H and ``values`` (k, d)
    the displacements g.
    """

    def __init__(
        self, comm: MPI.Intracomm, nodes: IndexArray, owned: int, held: FloatArray
    ) -> None:
        self.nodes, self.held = nodes, held
        self.values: FloatArray = np.zeros(held.shape[:2])
        self._comm, self._owned, self._mine = comm, owned, nodes < owned
        self._dim = held.shape[1]

    def project(self, values: FloatArray) -> None:
        """Remove the components along held directions from local or owned values, in place."""
        blocks, held = self._of(values)
        nodal = values.reshape(-1, self._dim)
        nodal[blocks] -= np.einsum("kij,kj->ki", held, nodal[blocks])

    def part_of(self, values: FloatArray) -> FloatArray:
        """The components along held directions of local or owned values, and 0 elsewhere."""
        blocks, held = self._of(values)
        along = np.zeros_like(values)
        nodal = values.reshape(-1, self._dim)[blocks]
        along.reshape(-1, self._dim)[blocks] = np.einsum("kij,kj->ki", held, nodal)
        return along

    def apply(self, values: FloatArray, share: float = 1.0) -> None:
        """Set the components of local values along held directions to a share of the prescribed."""
        self.project(values)
        values.reshape(-1, self._dim)[self.nodes] += share * self.values

    def without(self, nodes: IndexArray) -> HeldDirections:
        """The same directions without those at some local nodes."""
        kept = ~np.isin(self.nodes, nodes)
        directions = HeldDirections(self._comm, self.nodes[kept], self._owned, self.held[kept])
        directions.values = self.values[kept]
        return directions

    def eliminate(self, matrix: PETSc.Mat, holds: bool = True) -> None:
        """Replace an assembled matrix A by ``P A P + s H``, or by ``P A P`` alone; collective.

        s is the largest entry on the diagonal of A at the node.  The pattern of the matrix is
        symmetric and has whole blocks of a node's components.
        """
        if not self._is_anywhere:
            return
        owned, (first, _) = self.nodes[self._mine], matrix.getOwnershipRange()
        diagonal = matrix.getDiagonal()
        stiffness = diagonal.array_r.reshape(-1, self._dim)[owned].max(axis=1)
        # PETSc multiplies matrices that are stored entry by entry.
        plain, projection = matrix.convert("aij", PETSc.Mat()), self._projection(matrix)
        projected = plain.PtAP(projection)
        projected.convert(matrix.getType())
        matrix.zeroEntries()
        matrix.axpy(1.0, projected, PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        if holds:
            rows = (first // self._dim + owned[:, None]).astype(PETSc.IntType)
            blocks = stiffness[:, None, None] * self.held[self._mine]
            matrix.setValuesBlockedRCV(rows, rows, blocks, addv=PETSc.InsertMode.ADD_VALUES)
            matrix.assemble()
        for petsc_object in (diagonal, plain, projection, projected):
            petsc_object.destroy()

    def projected_columns(self, rows: PETSc.Mat) -> PETSc.Mat:
        """``B P`` for linear forms B (n, k) of displacements; B is destroyed; collective."""
        if not self._is_anywhere:
            return rows
        projection = self._projection(rows)
        product = rows.matMult(projection)
        for petsc_object in (projection, rows):
            petsc_object.destroy()
        return product

    def _projection(self, like: PETSc.Mat) -> PETSc.Mat:
        """P, to be multiplied to a matrix from the right; collective."""
        first, last = like.getOwnershipRangeColumn()
        blocks = np.tile(np.eye(self._dim), ((last - first) // self._dim, 1, 1))
        blocks[self.nodes[self._mine]] -= self.held[self._mine]
        return block_diagonal(blocks, like.getComm())

    def _of(self, values: FloatArray) -> tuple[IndexArray, FloatArray]:
        """The nodes with a place in an array of local or owned values, and their projections."""
        inside = self.nodes < len(values) // self._dim
        return self.nodes[inside], self.held[inside]

    @cached_property
    def _is_anywhere(self) -> bool:
        """Whether any rank has such a node; collective."""
        return on_any_rank(self._comm, self._mine)


class _OnAxes:
    """A condition for dofs (k,), as a `PlacedSupport` along axes; ``read`` has its values."""

    def __init__(
        self, key: str, dofs: IndexArray, read: Callable[[], FloatArray], dim: int
    ) -> None:
        self.key, self.dofs, self.read = key, dofs, read
        self.nodes, self.directions = dofs // dim, np.eye(dim)[dofs % dim]


class Constraints:
    """The displacement conditions of a space of displacements.

    ``dofs`` are the local dofs, ghosts included, that are fixed by components: by those of ``held``
    along an axis, ``components``, by the conditions of DOLFINx ``bcs``, and u_r on the axis of an
    axisymmetric body, which is zero.  ``oblique`` are those of ``held`` along other directions,
    which ``directions`` has node by node.  The values are read anew by :meth:`advance`.  The
    constructor is collective and, as :meth:`advance`, raises InputError for conditions that
    contradict each other or are too close to each other, and for one that moves the axis.
    """

    def __init__(
        self,
        domain: Domain,
        space: fem.FunctionSpace,
        held: Sequence[Support | Displacement],
        bcs: Sequence[fem.DirichletBC],
        clock: Clock,
    ) -> None:
        self.domain, self.space, self.bcs, self.share = domain, space, tuple(bcs), 1.0
        placed = [x for each in held for x in placed_supports(domain, space, each, clock)]
        self.components = tuple(each for each in placed if each.component is not None)
        self.oblique = tuple(each for each in placed if each.component is None)
        self._is_timed = bool(bcs) or any(each.present.value.is_timed for each in placed)
        empty, dim = np.empty(0, dtype=np.int32), domain.dim
        self._prescribed: list[PlacedSupport | _OnAxes] = [*self.oblique, *self.components]
        for number, condition in enumerate(bcs):
            dofs = np.asarray(condition.dof_indices()[0], dtype=np.int32)
            read = partial(self._read, condition, dofs)
            self._prescribed.append(_OnAxes(f"bcs.{number}", dofs, read, dim))
        if domain.axisymmetric:
            dofs = axis_dofs(domain, space)
            zero = np.zeros_like(dofs, dtype=float).copy
            self._prescribed.append(_OnAxes("", dofs, zero, dim))
        fixed = [empty, *(each.dofs for each in self._prescribed if each.dofs is not None)]
        self.dofs: IndexArray = np.unique(np.concatenate(fixed)).astype(np.int32)
        self._values = fem.Function(space)
        nodes = np.unique(np.concatenate([empty, *(condition.nodes for condition in self.oblique)]))
        # Every row of a node is the direction of one support or of one component condition.
        count, axes = len(self.oblique), np.arange(dim)
        self._rows = np.zeros((len(nodes), count + dim, dim))
        for number, condition in enumerate(self.oblique):
            self._rows[np.searchsorted(nodes, condition.nodes), number] = condition.directions
        self._rows[:, count + axes, axes] = self._mask.reshape(-1, dim)[nodes] == 0.0
        agree(domain.comm, lambda: self._refuse_close(nodes))
        projections, self._inverse = pseudo_inverse(self._rows)
        owned = space.dofmap.index_map.size_local
        self.directions = HeldDirections(domain.comm, nodes, owned, projections)
        self._combine()

    def advance(self) -> None:
        """Evaluate the prescribed values at the present time; collective."""
        if self._is_timed:
            self._combine()

    def _read(self, condition: fem.DirichletBC, dofs: IndexArray) -> FloatArray:
        values = np.zeros(self._points.size)
        condition.set(values)
        return values[dofs]

    @cached_property
    def _points(self) -> FloatArray:
        return np.asarray(self.space.tabulate_dof_coordinates()[:, : self.domain.dim])

    def _combine(self) -> None:
        """Compute the displacements that all conditions prescribe; collective."""
        values, u = [support.read() for support in self._prescribed], self._values.x.array
        for condition, amounts in zip(self._prescribed, values, strict=True):
            if condition.dofs is not None:
                u[condition.dofs] = amounts
        nodes, comm = self.directions.nodes, self.domain.comm
        prescribed = np.zeros(self._rows.shape[:2])
        for number, support in enumerate(self.oblique):
            prescribed[np.searchsorted(nodes, support.nodes), number] = values[number]
        nodal, count = u.reshape(-1, self.domain.dim), len(self.oblique)
        fixed = self._mask.reshape(nodal.shape)[nodes] == 0.0
        prescribed[:, count:] = np.where(fixed, nodal[nodes], 0.0)
        self.directions.values = np.einsum("kir,kr->ki", self._inverse, prescribed)
        whole = u.copy()
        self.directions.apply(whole)
        largest = maximum(comm, np.abs(np.concatenate([np.zeros(1), whole, *values])))
        agree(comm, lambda: self._refuse_conflict(whole, values, _AGREES * largest))

    def _refuse_conflict(self, u: FloatArray, values: Sequence[FloatArray], most: float) -> None:
        """Raise InputError where a condition prescribes another value than that of ``u``."""
        nodal = u.reshape(-1, self.domain.dim)
        for condition, prescribed in zip(self._prescribed, values, strict=True):
            defect = np.abs(
                np.sum(condition.directions * nodal[condition.nodes], axis=1) - prescribed
            )
            if not np.any(defect > most):
                continue
            number = int(np.argmax(defect))
            node, way = condition.nodes[number], condition.directions[number]
            where = self.domain.where(self._points[node])
            others = [
                (other, other_values[place])
                for other, other_values in zip(self._prescribed, values, strict=True)
                for place in np.flatnonzero(other.nodes == node)
                if other is not condition and abs(other.directions[place] @ way) > SAME
            ]
            other, value = others[-1]
            if not other.key:
                message = f"moves the axis x = 0 along x at {where}, where u_r is zero"
                raise InputError(message, condition.key)
            axis = f"component {AXES[np.argmax(np.abs(way))]} of the "
            axis = "" if condition.dofs is None else axis
            raise InputError(
                f"prescribes {prescribed[number]:.6g} for the {axis}displacement at "
                f"{where}, where another condition prescribes another value: "
                f"{other.key} prescribes {value:.6g}; give both conditions the same value there",
                condition.key,
            )

    def _refuse_close(self, nodes: IndexArray) -> None:
        """Raise InputError for two directions at a node that are almost the same."""
        for second, support in enumerate(self.oblique):
            for first in range(len(self._rows[0]) if len(nodes) else 0):
                if second <= first < len(self.oblique):
                    continue
                rows, others = self._rows[:, second], self._rows[:, first]
                held = np.any(rows != 0.0, axis=1) & np.any(others != 0.0, axis=1)
                cosine = np.sum(rows * others, axis=1)
                sine = np.linalg.norm(rows - cosine[:, None] * others, axis=1)
                close = (sine > SAME) & (sine < _TOO_CLOSE)
                is_normal = first < len(self.oblique) and self.oblique[first].is_normal
                if is_normal and support.is_normal:
                    close |= (sine > SAME) & (np.abs(cosine) > SMOOTH)
                if np.any(held & close):
                    where = self.domain.where(self._points[nodes[np.argmax(held & close)]])
                    raise InputError(
                        f"at {where} the direction is almost, and not quite, that of another "
                        "condition; let one entry with both names in its on hold both boundary "
                        "parts, or give both conditions the same direction",
                        support.key,
                    )

    @cached_property
    def conditions(self) -> list[fem.DirichletBC]:
        """The conditions of DOLFINx for each component."""
        dim = self.space.dofmap.index_map_bs
        by_axis = [(i, self.dofs[self.dofs % dim == i]) for i in range(dim)]
        return [fem.dirichletbc(self._values, [d, d], self.space.sub(i)) for i, d in by_axis]

    def apply(self, u: fem.Function) -> None:
        """Write the ``share`` of the prescribed values into ``u``: all of them unless it is set."""
        u.x.array[self.dofs] = self.share * self._values.x.array[self.dofs]
        self.directions.apply(u.x.array, self.share)
        u.x.scatter_forward()

    def free_part(self, values: FloatArray) -> FloatArray:
        """Local or owned values of a displacement field without the prescribed part."""
        free = values * self._mask[: len(values)]
        self.directions.project(free)
        return free

    def keep_free(self, forces: PETSc.Vec) -> None:
        """Reduce a vector of the matrix to its :meth:`free_part`; collective."""
        # PETSc keeps the norm of a vector until the array is given back.
        with forces as values:
            values[:] = self.free_part(np.asarray(values))

    def held_part(self, values: FloatArray) -> FloatArray:
        """The prescribed part of local or owned values of a displacement field."""
        held = values * (1.0 - self._mask[: len(values)])
        nodes = self.directions.nodes
        nodes = nodes[nodes < len(values) // self.space.dofmap.index_map_bs]
        shape = (-1, self.space.dofmap.index_map_bs)
        along = self.directions.part_of(values).reshape(shape)[nodes]
        held.reshape(shape)[nodes] = along
        return held

    def free_nodes(self) -> BoolArray:
        """Whether each owned node has a component that is not prescribed.

        A node that is held along every direction, and not by components, counts as free.
        """
        dofmap = self.space.dofmap
        mask = self._mask[: dofmap.index_map.size_local * dofmap.index_map_bs]
        return np.asarray(np.any(mask.reshape(-1, dofmap.index_map_bs) > 0.0, axis=1))

    def assemble_matrix(
        self, form: JointForm, matrix: PETSc.Mat, touching: Iterable[PointStiffness] = ()
    ) -> None:
        """Assemble a bilinear form, positive on the diagonal everywhere; collective.

        ``touching`` are stiffnesses to add.  The diagonal at constrained dofs is set to its least
        entry at free dofs, which has the same unit: with a 1 beside entries of 1e12, multigrid
        would estimate its largest eigenvalue from the constrained dofs alone.
        """
        form.assemble_matrix(matrix, self.conditions)
        for stiffness in touching:
            stiffness.add_to(matrix, self._mask)
        matrix.assemble()
        is_free = self._mask[: matrix.getLocalSize()[0]] > 0.0
        diagonal = matrix.getDiagonal()
        with diagonal as entries:
            least = minimum(self.space.mesh.comm, entries[is_free & (entries > 0.0)])
            entries[~is_free] = least if math.isfinite(least) else 1.0
        matrix.setDiagonal(diagonal)
        diagonal.destroy()
        self.directions.eliminate(matrix)

    def largest(self) -> float:
        """The largest prescribed component or displacement along a direction; collective."""
        local = [self.directions.values, self._values.x.array[self.dofs]]
        most = max(float(np.abs(values).max(initial=0.0)) for values in local)
        return maximum(self.space.mesh.comm, most)

    def with_fixed(self, nodes: IndexArray) -> Constraints:
        """These conditions, and zero for all components at some local nodes; collective."""
        constraints, dim = copy.copy(self), self.space.dofmap.index_map_bs
        constraints.__dict__.pop("_mask", None)
        constraints.__dict__.pop("conditions", None)
        fixed = (dim * nodes[:, None] + np.arange(dim)).reshape(-1)
        constraints.dofs = np.union1d(self.dofs, fixed).astype(np.int32)
        constraints._values = self._values.copy()
        constraints._values.x.array[fixed] = 0.0
        constraints.directions = self.directions.without(nodes)
        return constraints

    def free_dofs(self) -> FloatArray:
        """1 at free and 0 at fixed local dofs, ghosts included; supports do not count."""
        return self._mask

    @cached_property
    def _mask(self) -> FloatArray:
        index_map = self.space.dofmap.index_map
        count = index_map.size_local + index_map.num_ghosts
        mask = np.ones(count * self.space.dofmap.index_map_bs)
        mask[self.dofs] = 0.0
        return mask
