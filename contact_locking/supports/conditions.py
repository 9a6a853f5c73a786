"""Displacement conditions by components, and supports along other directions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from dolfinx import fem
from petsc4py import PETSc

from contact_locking import _compat
from contact_locking.arrays import AXES, BoolArray, FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem.contact_operator import PointStiffness
from contact_locking.fem.joint_forms import JointForm
from contact_locking.fields.clock import Clock
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.half_section import axis_condition
from contact_locking.parallel import agree, maximum, minimum
from contact_locking.supports.support import Support
from contact_locking.supports.supports import (
    AGREES,
    Supports,
    axis_of,
    place,
)


@dataclass(frozen=True)
class ComponentCondition:
    """``u_i = value(x)`` on the named boundary parts; ``value`` maps (d, k) to (k,).

    ``timed`` says that the values depend on the time.
    """

    on: tuple[str, ...]
    component: int
    value: Callable[[FloatArray], FloatArray]
    key: str
    timed: bool = False

    def write(self, function: fem.Function) -> None:
        """Interpolate the present values; collective."""
        dim = function.function_space.mesh.geometry.dim
        function.interpolate(lambda x: self.value(x[:dim]))


@dataclass(frozen=True)
class Constraints:
    """The conditions for DOLFINx, and the local dofs, ghosts included, that the conditions fix.

    ``wanted`` are the conditions for single components, and ``given`` those that were made as
    conditions of DOLFINx.  ``supports`` hold directions that are no axes.  ``timed`` pairs each
    condition that may change with the function of its values.
    """

    space: fem.FunctionSpace
    conditions: list[fem.DirichletBC]
    dofs: IndexArray
    supports: Supports
    wanted: Sequence[ComponentCondition] = ()
    timed: Sequence[tuple[ComponentCondition, fem.Function]] = ()
    given: Sequence[fem.DirichletBC] = ()

    def advance(self) -> None:
        """Evaluate the prescribed values at the present time; collective."""
        for condition, values in self.timed:
            condition.write(values)
        if self.timed or self.given or self.supports.timed:
            self.combine()

    def combine(self) -> None:
        """Find the displacements that supports and component conditions prescribe; collective.

        Raises InputError for two values of one direction.
        """
        u = fem.Function(self.space)
        for condition in self.conditions:
            condition.set(u.x.array)
        comm = self.space.mesh.comm
        most = AGREES * maximum(comm, np.abs(u.x.array))
        agree(comm, lambda: self._refuse_conflict(u.x.array, most))
        self.supports.advance(u)

    def _refuse_conflict(self, held: FloatArray, most: float) -> None:
        """Raise InputError where a condition prescribes another value than ``held`` (k,)."""
        for number, condition in enumerate(self.conditions):
            key = self._name(number)
            if not key:
                continue
            dofs, own = condition.dof_indices()[0], np.zeros_like(held)
            condition.set(own)
            defect = np.abs(own - held)[dofs]
            if not np.any(defect > most):
                continue
            dof = dofs[np.argmax(defect)]
            dim = self.space.dofmap.index_map_bs
            points = self.space.tabulate_dof_coordinates()
            where = self.supports.domain.where(points[dof // dim, :dim])
            others = [dof in other.dof_indices()[0] for other in self.conditions]
            last = len(others) - 1 - others[::-1].index(True)
            if last >= len(self.wanted) + len(self.given):
                raise InputError(f"moves the axis x = 0 along x at {where}, where u_r is zero", key)
            raise InputError(
                f"prescribes {own[dof]:.6g} for the component {AXES[dof % dim]} of the "
                f"displacement at {where}, where another condition prescribes another value: "
                f"{self._name(last)} prescribes {held[dof]:.6g}; give both conditions the "
                "same value there",
                key,
            )

    def _name(self, number: int) -> str:
        """The key of a condition; empty for that of the axis of revolution."""
        keys = [item.key for item in self.wanted]
        keys += [f"bcs.{own}" for own in range(len(self.given))]
        return keys[number] if number < len(keys) else ""

    def apply(self, u: fem.Function) -> None:
        """Write the prescribed values into ``u``."""
        for condition in self.conditions:
            condition.set(u.x.array)
        self.supports.directions.apply(u.x.array)
        u.x.scatter_forward()

    def free_part(self, values: FloatArray) -> FloatArray:
        """Local or owned values of a displacement field without the prescribed part."""
        free = values * self._mask[: len(values)]
        self.supports.directions.project(free)
        return free

    def keep_free(self, forces: PETSc.Vec) -> None:
        """Leave the :meth:`free_part` of a vector of the matrix; collective."""
        # PETSc keeps the norm of a vector until the array is given back.
        with forces as values:
            values[:] = self.free_part(np.asarray(values))

    def held_part(self, values: FloatArray) -> FloatArray:
        """The prescribed part of local or owned values of a displacement field."""
        held = values * (1.0 - self._mask[: len(values)])
        nodes = self.supports.directions.nodes
        nodes = nodes[nodes < len(values) // self.space.dofmap.index_map_bs]
        shape = (-1, self.space.dofmap.index_map_bs)
        along = self.supports.directions.part_of(values).reshape(shape)[nodes]
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

        ``touching`` are stiffnesses that are added.  Where conditions hold, the diagonal is its
        least entry at free dofs, in the same units.  With a 1 beside entries of 1e12, multigrid
        would estimate its largest eigenvalue from the held dofs alone.
        """
        form.assemble_matrix(matrix, self.conditions)
        for stiffness in touching:
            stiffness.add_to(matrix, self._mask)
        is_free = self._mask[: matrix.getLocalSize()[0]] > 0.0
        diagonal = matrix.getDiagonal()
        with diagonal as entries:
            least = minimum(self.space.mesh.comm, entries[is_free & (entries > 0.0)])
            entries[~is_free] = least if math.isfinite(least) else 1.0
        matrix.setDiagonal(diagonal)
        diagonal.destroy()
        self.supports.directions.eliminate(matrix)

    def largest(self) -> float:
        """The largest prescribed component or displacement along a direction; collective."""
        u = np.zeros_like(self._mask)
        for condition in self.conditions:
            condition.set(u)
        local = [self.supports.directions.values, u]
        most = max(float(np.abs(values).max(initial=0.0)) for values in local)
        return maximum(self.space.mesh.comm, most)

    def with_fixed(self, nodes: IndexArray, value: fem.Function) -> Constraints:
        """These conditions and one for all components at some local nodes; collective."""
        more = fem.dirichletbc(value, nodes)
        dim = self.space.dofmap.index_map_bs
        dofs = np.union1d(self.dofs, (dim * nodes[:, None] + np.arange(dim)).reshape(-1))
        supports = self.supports.without(nodes)
        return Constraints(
            self.space,
            [*self.conditions, more],
            dofs.astype(np.int32),
            supports,
            self.wanted,
            given=self.given,
        )

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


def constrain(
    domain: Domain,
    space: fem.FunctionSpace,
    wanted: Sequence[ComponentCondition],
    supports: Sequence[Support],
    given: Sequence[fem.DirichletBC],
    clock: Clock,
) -> Constraints:
    """The displacement conditions and supports of a space of displacements; collective.

    A support along an axis is a condition for a component.  ``given`` are conditions of DOLFINx,
    whose values are read anew before each solve.  On the axis of an axisymmetric body u_r is zero.
    Raises InputError for conditions that contradict each other, and for a condition that
    moves the axis.
    """
    oblique = []
    components: list[ComponentCondition] = []
    for support in supports:
        placed = place(domain, space, support, clock)
        axis = axis_of(domain, placed)
        if axis is None:
            oblique.append(placed)
            continue
        value = partial(_signed, placed.value, axis[1])
        is_timed = support.value.is_timed
        components.append(ComponentCondition(support.on, axis[0], value, support.key, is_timed))
    wanted = [*components, *wanted]
    conditions: list[fem.DirichletBC] = []
    timed: list[tuple[ComponentCondition, fem.Function]] = []
    fixed: list[IndexArray] = [np.empty(0, dtype=np.int32)]
    scalars = [_compat.collapse(space.sub(i))[0] for i in range(domain.dim)] if wanted else []
    for item in wanted:
        sub, scalar = space.sub(item.component), scalars[item.component]
        facets = domain.facets(item.on, item.key)
        values = fem.Function(scalar)
        item.write(values)
        if item.timed:
            timed.append((item, values))
        dofs = fem.locate_dofs_topological((sub, scalar), domain.dim - 1, facets)
        conditions.append(fem.dirichletbc(values, dofs, sub))
        fixed.append(np.asarray(dofs[0], dtype=np.int32))
    for own in given:
        conditions.append(own)
        fixed.append(np.asarray(own.dof_indices()[0], dtype=np.int32))
    if domain.axisymmetric:
        on_axis = axis_condition(domain, space)
        conditions.append(on_axis)
        fixed.append(np.asarray(on_axis.dof_indices()[0], dtype=np.int32))
    fixed_dofs = np.unique(np.concatenate(fixed))
    index_map = space.dofmap.index_map
    marks = np.zeros((index_map.size_local + index_map.num_ghosts) * domain.dim, dtype=bool)
    marks[fixed_dofs] = True
    held = Supports(domain, space, oblique, marks)
    made = Constraints(space, conditions, fixed_dofs, held, tuple(wanted), timed, tuple(given))
    made.combine()
    return made


def _signed(value: Callable[[FloatArray], FloatArray], sign: float, x: FloatArray) -> FloatArray:
    return sign * value(x)
