"""The elastic forces, the tangent with all cones eliminated, and linear solves with it."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking.arrays import FloatArray, IndexArray
from contact_locking.errors import NotConverged
from contact_locking.fem import compiled
from contact_locking.fem.compiled import JointForm
from contact_locking.problem.rounding import ROUNDING
from contact_locking.solver.interior_point.contact_cones import ContactNodes, OnContact
from contact_locking.solver.interior_point.family import Family, Reactions
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.ksp import IN_BLOCKS, is_direct, stacked
from contact_locking.solver.multigrid import StiffPart
from contact_locking.solver.tangent_solver import Follow, tangent_solver
from contact_locking.solver.task import Task

# The most halvings of a step along which the forces of a body are not linear.
_HALVINGS = 40
# The accuracy of iterative solves for the columns of the travels, and the least Schur complement
# over the corner, below which it is rounding.
_BORDER_ACCURACY, _LEAST = 1e-10, 1e-15


class Tangent:
    """``a(du, v)`` plus ``int D lin(du) . lin(v)`` of every family, and the forces it balances.

    Displacements and forces are arrays of owned values, followed by one entry for the travel of
    each pushed foundation (tool), the same on all ranks.  Elastic and spring forces are those at
    the last :meth:`update`.  Methods are collective.

    The travels q border the tangent K: ``K x + B q = r``, ``B^T x + C q = s``.  ``K Y = B`` is
    solved once for each tangent.  Then ``(C - B^T Y) q = s - B^T x_0`` and ``x = x_0 - Y q`` with
    ``K x_0 = r``.  A travel with a zero on the diagonal of C is zero.
    """

    def __init__(self, task: Task, families: Sequence[Family], tuning: Tuning) -> None:
        self.system, self.comm = task.system, task.system.comm
        self.families, self._tolerance = families, task.settings.tolerance
        self._tuning, self._material = tuning, task.target.stiffness
        system, data = task.system, task.system.data
        space = system.u.function_space
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self.energy = self.force_scale = 0.0
        v, du = ufl.TestFunction(space), ufl.TrialFunction(space)
        #: Whether the forces of the body are linear in its displacement.
        self.is_linear = data.own_energy is None
        elastic = system.stiffness
        self._touching = [family for family in families if isinstance(family, OnContact)]
        strained = [family for family in families if isinstance(family, LimitsOfStrain)]
        operators = {id(family.nodes): family.nodes.operator for family in self._touching}
        terms = [family.tangent_term(v, du) for family in strained]
        compiled_elastic = system.kept.form(elastic)

        def compile_form(part: ufl.Form) -> fem.Form:
            return compiled_elastic if part.equals(elastic) else compiled.form(part)

        self._form = JointForm(sum(terms, start=elastic), compile_form)
        # Blocks make products fast, and a factorisation does not need them.
        if self.comm.size == 1 and is_direct(task.settings.linear, system.dim, system.size):
            self.matrix = self._form.create_shared_matrix(list(operators.values()))
        else:
            self.matrix = self._form.create_matrix(list(operators.values()), IN_BLOCKS)
        self._near_nullspace = system.near_nullspace()
        self.matrix.setNearNullSpace(self._near_nullspace)
        self._compiled_elastic = compiled_elastic
        self.elasticity = petsc.assemble_matrix(compiled_elastic)
        self.elasticity.assemble()
        self._stiffest = float(self.elasticity.norm(PETSc.NormType.NORM_INFINITY))
        self._vectors = [self.matrix.createVecRight() for _ in range(5)]
        self._step, self._answer, self._right, self._moved, self._product = self._vectors
        #: The loads, and the elastic forces.
        self.load = self.stretched = self._unbalanced = self.zeros()
        self.linear = tangent_solver(self.matrix, task)
        #: The direct solver of the tangents, if any.
        self.direct = self.linear.direct

    def update(self) -> None:
        """Evaluate elastic forces, energy and all families at the system's displacement."""
        system, tools = self.system, self.system.tools
        displacement = self.present()
        for family in self.families:
            family.update(displacement)
        displacement[self._owned :] = tools.travels
        self.load = np.append(system.load, tools.forces)
        if self.is_linear:
            self.stretched = self.elastic_times(displacement)
            self.energy = self._energy_of(displacement)
        else:
            sprung = tools.stiffnesses * displacement[self._owned :]
            self.stretched = np.append(self._body_forces(), sprung)
            self.energy = system.energy()
        acting = max(self._norm(self.load), self._norm(self.stretched))
        self.force_scale = system.rounding.raise_above(acting, self._tolerance)
        self._unbalanced = self.stretched - self.load

    def load_work(self) -> float:
        """``(f, u)`` of the system's displacement."""
        return self._dot(self.load, self.present())

    def refresh(self) -> None:
        """Assemble the tangent with the present blocks of all families."""
        for family in self.families:
            family.write_block()
        if not self.is_linear:
            self.elasticity.zeroEntries()
            petsc.assemble_matrix(self.elasticity, self._compiled_elastic)
            self.elasticity.assemble()
        self.linear.refresh(self._assemble, self.stiff_part)
        self._refresh_border()
        self._step.set(0.0)

    def residual_norms(self, reactions: Reactions) -> tuple[float, float]:
        """The norms of the unbalanced forces at free dofs, and of those at held dofs."""
        forces = self._unbalanced + self.forces(reactions)
        free = self._free(forces)
        return self._norm(free), self._norm(forces - free)

    def tool_residual(self, reactions: Reactions) -> float:
        """The largest unbalanced force on an acting tool, relative to its forces."""
        tools = self.system.tools
        if not tools:
            return 0.0
        unbalanced = (self._unbalanced + self.forces(reactions))[self._owned :]
        local = np.zeros(len(tools))
        for family, values in reactions.items():
            family.add_tool_forces(values, local, magnitudes=True)
        sizes = np.maximum(self.comm.allreduce(local), np.abs(tools.forces))
        acting = np.array([tool.acts for tool in tools]) & (sizes > 0.0)
        return float(np.max(np.abs(unbalanced)[acting] / sizes[acting], initial=0.0))

    @property
    def tools_rest(self) -> bool:
        """Whether no force or spring acts on a tool at the present travels."""
        return not self._unbalanced[self._owned :].any()

    def solve_step(
        self, reactions: Reactions, accuracy: float, is_rough: bool = False
    ) -> FloatArray:
        """The displacement step that balances these reactions.

        ``accuracy`` is the residual of an iterative solver, relative to the forces; it starts from
        the previous step.
        """
        right = -self._unbalanced - self.forces(reactions)
        return self._solve(right, self._step, accuracy * self.force_scale, is_rough)

    def step_after(self, step: FloatArray, reactions: Reactions, accuracy: float) -> FloatArray:
        """As :meth:`solve_step`, from zero and with the elastic forces of ``step`` added before."""
        self._unbalanced = self._unbalanced + self.elastic_times(step)
        self._step.set(0.0)
        return self.solve_step(reactions, accuracy, is_rough=True)

    @property
    def solves_following(self) -> bool:
        """Whether :meth:`solve_following` is available: not while a tool presses."""
        return self.linear.solves_following and not self.system.tools.act

    def solve_following(
        self,
        reactions: Reactions,
        follow: Callable[[FloatArray], Reactions],
        accuracy: float,
    ) -> FloatArray:
        """The step that balances reactions and others that depend linearly on the step.

        ``follow`` computes the latter for a displacement step; otherwise as :meth:`solve_step`.
        """

        def add_following(x: PETSc.Vec, y: PETSc.Vec) -> None:
            # The stiffness of contact would amplify errors of prescribed displacements.
            free = self.system.constraints.free_part(x.array_r)
            following = self._free(self.forces(follow(self._with_tools_at_rest(free))))
            y.array_w[:] += following[: self._owned]

        right = -self._unbalanced - self.forces(reactions)
        return self._solve(right, self._step, accuracy * self.force_scale, False, add_following)

    def respond(self, reactions: Reactions, accuracy: float) -> FloatArray:
        """The displacement that a change of reactions causes."""
        return self.answer(-self.forces(reactions), accuracy, is_rough=True)

    def answer(self, forces: FloatArray, accuracy: float, is_rough: bool = False) -> FloatArray:
        """The displacement for forces, to the relative ``accuracy`` of an iterative solver."""
        self._answer.set(0.0)
        residual = accuracy * self._norm(self._free(forces))
        return self._solve(forces, self._answer, residual, is_rough)

    def residual_forces(self) -> float:
        """The sum of the magnitudes of the nodal forces that the last :meth:`answer` leaves."""
        self.linear.multiply(self._answer, self._moved)
        self._moved.axpy(-1.0, self._right)
        return float(self._moved.norm(PETSc.NormType.NORM_1))

    def elastic_times(self, displacement: FloatArray) -> FloatArray:
        """The elastic forces of a displacement, with those of springs on the travels."""
        self._moved.array_w[:] = displacement[: self._owned]
        self.elasticity.mult(self._moved, self._product)
        sprung = self.system.tools.stiffnesses * displacement[self._owned :]
        return np.append(self._product.array_r, sprung)

    def forces(self, reactions: Reactions) -> FloatArray:
        """The forces of reactions, at held dofs as well."""
        self._moved.set(0.0)
        on_tools = np.zeros(len(self.system.tools))
        for family, values in reactions.items():
            family.add_forces(values, self._moved)
            family.add_tool_forces(values, on_tools)
        if self.system.tools:
            on_tools = self.comm.allreduce(on_tools)
        return np.append(self._moved.array_r, on_tools)

    def zeros(self) -> FloatArray:
        """A displacement step of zero."""
        return np.zeros(self._owned + len(self.system.tools))

    def present(self) -> FloatArray:
        """The system's displacement, for gaps that contain the travels of the tools."""
        return self._with_tools_at_rest(self.system.u.x.array[: self._owned])

    def trusted(self, t: float, step: FloatArray) -> float:
        """The length t, halved until the tangent predicts the forces of the body well enough.

        Along a step s with ``q = s . K s`` the slope of the convex energy of the body may exceed
        that of the tangent K by ``q/2``, or the forces differ by less than the tolerance.  Without
        constraints the full step then at least halves the slope.
        """
        if self.is_linear:
            return t
        u, owned, most = self.system.u.x, step[: self._owned], self._tolerance * self.force_scale
        start, before = u.array.copy(), self._body_forces()
        foreseen = self.elastic_times(step)[: self._owned]
        try:
            for _ in range(_HALVINGS):
                u.array[: self._owned] = start[: self._owned] + t * owned
                u.scatter_forward()
                above = self._body_forces() - before - t * foreseen
                local = np.array([above @ owned, foreseen @ owned, above @ above, owned @ owned])
                slope, square, distance, size = self.comm.allreduce(local)
                if square < -most * math.sqrt(size):
                    raise NotConverged("the energy of the body is not convex")
                # The user's energy may be NaN beyond some strain.
                exists = math.isfinite(self.system.forms.own_energy(self.system.u))
                if exists and (slope <= 0.5 * square or math.sqrt(distance) <= most):
                    break
                t *= 0.5
            return t
        finally:
            u.array[:] = start

    def _body_forces(self) -> FloatArray:
        return self.system.forms.body_forces(self.system.u)[: self._owned]

    def move(self, t: float, step: FloatArray) -> None:
        """Add ``t step`` to the system's displacement and travels."""
        self.system.u.x.array[: self._owned] += t * step[: self._owned]
        # Steps that are larger than the solution leave their rounding in the prescribed values.
        self.system.constraints.apply(self.system.u)
        tools = self.system.tools
        tools.travels = tuple(np.add(tools.travels, t * step[self._owned :]))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.linear.destroy()
        for petsc_object in (self.matrix, self.elasticity, self._near_nullspace, *self._vectors):
            petsc_object.destroy()

    def stiff_part(self) -> StiffPart:
        """The part of the tangent that is stiffer than the material, for the preconditioner."""
        tuning, is_linear = self._tuning, self.system.data.element.degree == 1
        along = tuning.stiff_along if is_linear else tuning.stiff_along_quadratic

        def assemble_rest(factor: float, rest: PETSc.Mat) -> None:
            for family in self.families:
                family.soften(factor, self._material)
            self._assemble(rest)

        return StiffPart(
            self._stiff_nodes(tuning.stiff),
            lambda: self._stiff_nodes(tuning.nearly_stiff),
            functools.partial(assemble_rest, tuning.stiff),
            lambda: self._stiff_rows(along),
            functools.partial(assemble_rest, along),
        )

    def _stiff_rows(self, factor: float) -> tuple[PETSc.Mat, FloatArray]:
        """The stiff rows of all families, without the columns of prescribed displacements."""
        pairs = [family.stiff_rows(factor, self._material) for family in self.families]
        rows = stacked([part for part, _ in pairs])
        free, constraints = self.matrix.createVecRight(), self.system.constraints
        free.array_w[:] = constraints.free_dofs()[: self._owned]
        rows.diagonalScale(None, free)
        free.destroy()
        rows = constraints.directions.projected_columns(rows)
        return rows, np.concatenate([stiffness for _, stiffness in pairs])

    def _stiff_nodes(self, factor: float) -> IndexArray:
        """The owned nodes, not fully prescribed, where a family is stiffer than the material."""
        stiff = (family.stiff_nodes(factor, self._material) for family in self.families)
        nodes = functools.reduce(np.union1d, stiff)
        is_free = self.system.constraints.free_nodes()
        return nodes[is_free[nodes]].astype(np.int32)

    def _assemble(self, matrix: PETSc.Mat) -> None:
        blocks: dict[ContactNodes, FloatArray] = {}
        for family in self._touching:
            blocks[family.nodes] = blocks.get(family.nodes, 0.0) + family.tangent_block
        touching = [nodes.stiffness(block) for nodes, block in blocks.items()]
        self.system.constraints.assemble_matrix(self._form, matrix, touching)

    def _refresh_border(self) -> None:
        """Solve for the response to each travel, and compute the Schur complement."""
        count = len(self.system.tools)
        self._border, self._responses = np.zeros((2, count, self._owned))
        corner = np.diag(self.system.tools.stiffnesses)
        for number in range(count):
            travel = self.zeros()
            travel[self._owned + number] = 1.0
            pressed = [family for family in self.families if family.tool == number]
            reactions = {family: family.block(family.see(travel)) for family in pressed}
            forces = self._free(self.forces(reactions))
            corner[:, number] += forces[self._owned :]
            self._border[number] = forces[: self._owned]
            self._answer.set(0.0)
            residual = _BORDER_ACCURACY * self._norm(forces)
            self._responses[number] = self._solve_nodes(forces, self._answer, residual, True)
        schur = corner - self.comm.allreduce(self._border @ self._responses.T)
        schur = 0.5 * (schur + schur.T)
        np.fill_diagonal(schur, np.maximum(np.diag(schur), _LEAST * np.diag(corner)))
        self._idle = np.diag(corner) == 0.0
        schur[self._idle], schur[:, self._idle] = 0.0, 0.0
        schur[self._idle, self._idle] = 1.0
        self._schur = schur

    def _solve(
        self,
        forces: FloatArray,
        start: PETSc.Vec,
        residual: float,
        is_rough: bool = False,
        follow: Follow | None = None,
    ) -> FloatArray:
        """The displacement with the travels for forces, ignoring those at held dofs.

        ``start`` is the initial guess without the travels, and is overwritten; ``residual`` is that
        of an iterative solver.
        """
        nodal = self._solve_nodes(forces, start, residual, is_rough, follow)
        if not self.system.tools:
            return self.system.constraints.free_part(nodal)
        right = forces[self._owned :] - self.comm.allreduce(self._border @ nodal)
        right[self._idle] = 0.0
        # Every rank takes the same step, to the last digit.
        travels = self.comm.bcast(np.linalg.solve(self._schur, right))
        return self._free(np.append(nodal - travels @ self._responses, travels))

    def _solve_nodes(
        self,
        forces: FloatArray,
        start: PETSc.Vec,
        residual: float,
        is_rough: bool = False,
        follow: Follow | None = None,
    ) -> FloatArray:
        """The displacement for fixed travels."""
        self._right.array_w[:] = self._free(forces)[: self._owned]
        if self._right.norm() > 0.0 or start.norm() > 0.0:
            self.linear.solve(self._right, start, residual, is_rough, follow)
        return start.array_r

    def _free(self, forces: FloatArray) -> FloatArray:
        """The forces, with zeros at held dofs."""
        free = self.system.constraints.free_part(forces[: self._owned])
        return np.append(free, forces[self._owned :])

    def _dot(self, x: FloatArray, y: FloatArray) -> float:
        return float(self.comm.allreduce(x[: self._owned] @ y[: self._owned]))

    def _norm(self, forces: FloatArray) -> float:
        return math.sqrt(self._dot(forces, forces))

    def _with_tools_at_rest(self, owned: FloatArray) -> FloatArray:
        return np.append(owned, np.zeros(len(self.system.tools)))

    def _energy_of(self, displacement: FloatArray) -> float:
        """``a(u, u)/2``."""
        energy = 0.5 * self._dot(self.stretched, displacement)
        # If the body moves far more than it is strained, elastic forces are small differences, and
        # the product multiplies their rounding by the whole motion.  Integrating the strains has
        # far less rounding but takes longer.
        rounding = ROUNDING * self._stiffest * self._dot(displacement, displacement)
        return energy if energy >= rounding else self.system.energy()
