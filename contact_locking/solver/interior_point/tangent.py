"""The elastic forces, the tangent with all cones eliminated, and the linear solves with it."""

from __future__ import annotations

import functools
from collections.abc import Iterable, Sequence

import numpy as np
import ufl
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.problem import compiled, forms
from contact_locking.problem.joint_forms import JointForm
from contact_locking.solver.interior_point.family import Family, Reaction
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.linear.filtered_multigrid import StiffPart
from contact_locking.solver.linear.storage import IN_BLOCKS, stacked
from contact_locking.solver.linear.tangent_solver import TangentSolver
from contact_locking.solver.task import Task


class Tangent:
    """``a(du, v)`` plus ``int D lin(du) . lin(v)`` of every family, and the forces it balances.

    Displacements are arrays of owned values.  What is asked for at the system's displacement,
    :meth:`visit` evaluates.
    """

    def __init__(self, task: Task, families: Sequence[Family], tuning: Tuning) -> None:
        self.system, self.comm = task.system, task.system.comm
        self.families, self._tuning = families, tuning
        self._material, self._tolerance = task.target.stiffness, task.settings.tolerance
        system, data = task.system, task.system.data
        space = system.u.function_space
        self._dim = system.dim
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self._free = system.free_dofs()[: self._owned]
        self.energy = self.force_scale = 0.0
        v, du = ufl.TestFunction(space), ufl.TrialFunction(space)
        elastic = forms.elastic_form(du, v, data)
        terms = [family.tangent_term(v, du) for family in families]
        self._form = JointForm(sum(terms, start=elastic))
        self.matrix = self._form.create_matrix(IN_BLOCKS)
        self._near_nullspace = system.near_nullspace()
        self.matrix.setNearNullSpace(self._near_nullspace)
        self._elasticity = petsc.assemble_matrix(compiled.form(elastic))
        self._elasticity.assemble()
        vectors = [self.matrix.createVecRight() for _ in range(6)]
        self._load, self._stretched, self._unbalanced, self._right = vectors[:4]
        self._step, self._answer = vectors[4:]
        self._load.array_w[:] = system.load
        self._linear = TangentSolver(self.matrix, self._dim, task.settings, task.monitor.linear)

    def visit(self) -> None:
        """Evaluate the elastic forces and the energy of the system's displacement; collective."""
        displacement = self._answer
        displacement.array_w[:] = self.system.u.x.array[: self._owned]
        self._elasticity.mult(displacement, self._stretched)
        self.energy = 0.5 * float(self._stretched.dot(displacement))
        acting = max(self._load.norm(), self._stretched.norm())
        self.force_scale = self.system.above_rounding(float(acting), self._tolerance)
        self._unbalanced.waxpy(-1.0, self._load, self._stretched)

    def refresh(self) -> None:
        """Assemble the tangent for the present blocks of all families; collective."""
        for family in self.families:
            family.write_block()
        self._assemble(self.matrix)
        self._linear.refresh(self._stiff_part)
        self._step.set(0.0)

    def residual_norm(self, reactions: Iterable[Reaction]) -> float:
        """``|a(u, .) + (Z, eps(.)) + int p v_nu - sigma_tau . v_tau - (f, .)|`` over free dofs.

        ``u`` is the displacement visited last; collective.
        """
        self._find_residual(reactions)
        return float(self._right.norm())

    def solve_step(self, reactions: Iterable[Reaction], accuracy: float = 0.0) -> FloatArray:
        """The displacement step that balances these reactions; collective.

        An iterative solver leaves a residual of ``accuracy``, relative to the forces, at most, and
        starts from the step before, if that was for the same blocks.
        """
        self._find_residual(reactions)
        self._right.scale(-1.0)
        self._linear.solve(self._right, self._step, accuracy * self.force_scale)
        return self._step.array_r * self._free

    def elastic_parts(
        self, accuracy: float, reactions: Iterable[Reaction]
    ) -> tuple[FloatArray, FloatArray]:
        """Steps by prescribed values, with given reactions, and by loads; collective.

        The first balances the elastic forces of the displacement visited last; an iterative solver
        leaves the share ``accuracy`` of either.
        """
        self._stretched.copy(self._right)
        moved = self._solve_for(reactions, -1.0, accuracy)
        self._load.copy(self._right)
        return moved, self._solve_for([], 1.0, accuracy)

    def balance(self, reactions: Iterable[Reaction], accuracy: float) -> FloatArray:
        """The displacement whose forces are those of the reactions; collective.

        An iterative solver leaves the share ``accuracy`` of the forces.
        """
        self._right.set(0.0)
        return self._solve_for(reactions, 1.0, accuracy)

    def respond(self, reactions: Iterable[Reaction], accuracy: float) -> FloatArray:
        """The displacement that answers a change of reactions; collective.

        An iterative solver leaves the share ``accuracy`` of the change.
        """
        self._right.set(0.0)
        return self._solve_for(reactions, -1.0, accuracy, is_rough=True)

    def nothing(self) -> FloatArray:
        """A displacement step of zero."""
        return np.zeros(self._owned)

    def move(self, t: float, step: FloatArray) -> None:
        """Add ``t step`` to the system's displacement; collective."""
        self.system.u.x.array[: self._owned] += t * step
        self.system.u.x.scatter_forward()

    @property
    def direct(self) -> PETSc.KSP | None:
        """The direct solver of the tangents, if any, until :meth:`destroy`."""
        return self._linear.direct

    def take_iterations(self) -> int:
        """The Krylov iterations since the last call."""
        return self._linear.take_iterations()

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._linear.destroy()
        for item in (
            self.matrix,
            self._elasticity,
            self._near_nullspace,
            self._load,
            self._stretched,
            self._unbalanced,
            self._right,
            self._step,
            self._answer,
        ):
            item.destroy()

    def _assemble(self, matrix: PETSc.Mat) -> None:
        self._form.assemble_matrix(matrix, self.system.conditions)

    def _stiff_part(self) -> StiffPart:
        """What the filter of the multigrid takes; collective."""
        stiff, nearly = self._tuning.stiff, self._tuning.nearly_stiff
        along = self._tuning.stiff_along

        def assemble_rest(matrix: PETSc.Mat) -> None:
            for family in self.families:
                family.soften(stiff, self._material)
            self._assemble(matrix)

        def assemble_across(matrix: PETSc.Mat) -> None:
            for family in self.families:
                family.soften_along(along, self._material)
            self._assemble(matrix)

        return StiffPart(
            self._stiff_nodes(stiff),
            lambda: self._stiff_nodes(nearly),
            assemble_rest,
            lambda: self._stiff_strains(along),
            assemble_across,
        )

    def _stiff_strains(self, factor: float) -> tuple[PETSc.Mat, FloatArray]:
        """The rows of all families, with zero columns for what is prescribed; collective."""
        given = (family.stiff_strains(factor, self._material) for family in self.families)
        found = [part for part in given if part is not None]
        rows = stacked([matrix for matrix, _ in found], self.matrix)
        free = self.matrix.createVecRight()
        free.array_w[:] = self._free
        rows.diagonalScale(None, free)
        free.destroy()
        return rows, np.concatenate([stiffness for _, stiffness in found])

    def _stiff_nodes(self, factor: float) -> IndexArray:
        """The owned nodes with something free that are stiffer than the material; collective."""
        found = (family.stiff_nodes(factor, self._material) for family in self.families)
        nodes = functools.reduce(np.union1d, found)
        is_free = np.any(self._free.reshape(-1, self._dim) > 0.0, axis=1)
        return nodes[is_free[nodes]].astype(np.int32)

    def _find_residual(self, reactions: Iterable[Reaction]) -> None:
        self._unbalanced.copy(self._right)
        self._add(reactions)

    def _add(self, reactions: Iterable[Reaction]) -> None:
        for reaction in reactions:
            reaction.add_to(self._right)
        # PETSc keeps the norm of a vector until the array is given back.
        with self._right as right:
            right *= self._free

    def _solve_for(
        self, reactions: Iterable[Reaction], sign: float, accuracy: float, is_rough: bool = False
    ) -> FloatArray:
        """Solve for ``sign`` times the right-hand side that there is with reactions added."""
        self._add(reactions)
        self._right.scale(sign)
        residual = accuracy * float(self._right.norm())
        self._answer.set(0.0)
        if self._right.norm() > 0.0:
            self._linear.solve(self._right, self._answer, residual, is_rough)
        return self._answer.array_r * self._free
