"""The elastic forces, the tangent with all cones eliminated, and the linear solves with it."""

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
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.contact_cones import ContactNodes, OnContact
from contact_locking.solver.interior_point.family import Family, Reaction
from contact_locking.solver.interior_point.locking_cones import LimitsOfStrain
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.linear.border import Border
from contact_locking.solver.linear.ksp import IN_BLOCKS, is_direct, stacked
from contact_locking.solver.linear.multigrid import StiffPart
from contact_locking.solver.linear.tangent_solver import tangent_solver
from contact_locking.solver.task import Task


class RightHandSide:
    """Nodal forces in a ``vector`` that belongs to this object, and those along motions of tools.

    All ranks have the latter, (T,).
    """

    def __init__(self, system: System, vector: PETSc.Vec) -> None:
        self._system, self.on_nodes = system, vector
        self.on_tools: FloatArray = np.zeros(len(system.tools))

    def start(self, forces: PETSc.Vec | None = None, on_tools: FloatArray | float = 0.0) -> None:
        """Take nodal forces, or none, and forces along the motions of the tools."""
        if forces is None:
            self.on_nodes.set(0.0)
        else:
            forces.copy(self.on_nodes)
        self.on_tools = np.zeros(len(self._system.tools)) + on_tools

    def add(self, reactions: Sequence[Reaction]) -> float:
        """Add reactions; the norm of all nodal forces, of which held ones then go; collective."""
        self.add_all(reactions)
        every = float(self.on_nodes.norm())
        self._system.constraints.keep_free(self.on_nodes)
        return every

    def add_all(self, reactions: Sequence[Reaction]) -> None:
        """Add reactions, with the forces at held dofs; collective."""
        for reaction in reactions:
            reaction.add_to(self.on_nodes)
        if self._system.tools:
            local = np.zeros_like(self.on_tools)
            for reaction in reactions:
                reaction.family.add_tool_forces(reaction.values, local)
            self.on_tools = self.on_tools + self._system.comm.allreduce(local)

    def scale(self, factor: float) -> None:
        """Multiply all forces."""
        self.on_nodes.scale(factor)
        self.on_tools *= factor


def energy_of(system: System, displacement: PETSc.Vec, forces: PETSc.Vec, stiffest: float) -> float:
    """``a(u, u)/2`` of a displacement with its elastic forces; collective."""
    energy = 0.5 * float(forces.dot(displacement))
    # The elastic forces at a body that moves far more than it is strained are small differences,
    # and the product multiplies their rounding by the whole motion.  The strains of its cells have
    # far less rounding, but to integrate them takes longer.
    rounding = ROUNDING * stiffest * float(displacement.dot(displacement))
    return energy if energy >= rounding else system.energy()


# The most halvings of a step along which the forces of a body are not linear.
_HALVINGS = 40
# An iterative solver leaves this share of the column of a travel.
_BORDER_ACCURACY = 1e-10


class Tangent:
    """``a(du, v)`` plus ``int D lin(du) . lin(v)`` of every family, and the forces it balances.

    Displacements are arrays of owned values, then the travels of the tools, which all ranks have;
    these border the tangent.  Elastic forces are those of the displacement visited last, and those
    of the springs of tools are those of the travels at that time.
    """

    def __init__(self, task: Task, families: Sequence[Family], tuning: Tuning) -> None:
        self.system, self.comm = task.system, task.system.comm
        self.families, self._tolerance = families, task.settings.tolerance
        self._tuning, self._material = tuning, task.target.stiffness
        system, data = task.system, task.system.data
        space = system.u.function_space
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self.energy = self.force_scale = self.acting = 0.0
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
        # In blocks products are fast, but a factorisation needs none.
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
        self._vectors = [self.matrix.createVecRight() for _ in range(7)]
        self._load, self._stretched, self._unbalanced = self._vectors[:3]
        self._step, self._answer, self._whole, self._moved = self._vectors[3:]
        self._right = RightHandSide(system, self.matrix.createVecRight())
        self._border = Border(len(system.tools), self.matrix.createVecRight)
        self._sprung: FloatArray = np.zeros(len(system.tools))
        self._unbalanced_tools: FloatArray = self._sprung
        self._linear = tangent_solver(
            self.matrix,
            system.dim,
            data.element.degree,
            task.settings,
            # About how many times stiffer than the material locked cells can become.
            task.target.penalty.n / self._material,
            task.monitor.linear,
            system.coarser_spaces,
        )

    def visit(self) -> None:
        """Evaluate the elastic forces and the energy of the system's displacement; collective."""
        self._load.array_w[:] = self.system.load
        self._answer.array_w[:] = self.system.u.x.array[: self._owned]
        if self.is_linear:
            self.elasticity.mult(self._answer, self._stretched)
            self.energy = energy_of(self.system, self._answer, self._stretched, self._stiffest)
        else:
            self._stretched.array_w[:] = self._body_forces()
            self.energy = self.system.energy()
        self.acting = float(max(self._load.norm(), self._stretched.norm()))
        self.force_scale = self.system.rounding.raise_above(self.acting, self._tolerance)
        self._unbalanced.waxpy(-1.0, self._load, self._stretched)
        tools = self.system.tools
        self._sprung = tools.stiffnesses * np.array(tools.travels)
        self._unbalanced_tools = self._sprung - tools.forces

    def load_work(self) -> float:
        """``(f, u)`` of the displacement visited last; collective."""
        return float(self._load.dot(self._answer))

    def refresh(self) -> None:
        """Set up linear solves for the present blocks of all families; collective."""
        for family in self.families:
            family.write_block()
        if not self.is_linear:
            self.elasticity.zeroEntries()
            petsc.assemble_matrix(self.elasticity, self._compiled_elastic)
            self.elasticity.assemble()
        self._linear.refresh(self._assemble, self.stiff_part)
        self._refresh_border()
        self._step.set(0.0)

    def residual_norms(self, reactions: Sequence[Reaction]) -> tuple[float, float]:
        """The unbalanced forces over free dofs, then those over held ones; collective."""
        every = self._find_residual(reactions)
        left = float(self._right.on_nodes.norm())
        return left, math.sqrt(max(every**2 - left**2, 0.0))

    def tool_residual(self, reactions: Sequence[Reaction]) -> float:
        """The largest share of its forces that an acting tool leaves unbalanced; collective."""
        tools = self.system.tools
        if not tools:
            return 0.0
        self._find_residual(reactions)
        local = np.zeros(len(tools))
        for reaction in reactions:
            reaction.family.add_tool_forces(reaction.values, local, magnitudes=True)
        sizes = np.maximum(self.comm.allreduce(local), np.abs(tools.forces))
        acting = np.array([tool.acts for tool in tools]) & (sizes > 0.0)
        return float(np.max(np.abs(self._right.on_tools)[acting] / sizes[acting], initial=0.0))

    @property
    def tools_rest(self) -> bool:
        """Whether no force or spring presses a tool onto the body, at the displacement visited."""
        return not self._unbalanced_tools.any()

    def solve_step(
        self, reactions: Sequence[Reaction], accuracy: float, is_rough: bool = False
    ) -> FloatArray:
        """The displacement step that balances these reactions; collective.

        An iterative solver leaves a residual of ``accuracy``, relative to the forces, at most, and
        starts from the step before.
        """
        self._find_residual(reactions)
        self._right.scale(-1.0)
        self._linear.solve(self._right.on_nodes, self._step, accuracy * self.force_scale, is_rough)
        return self._with_travels(self._step)

    def step_after(
        self, step: FloatArray, reactions: Sequence[Reaction], accuracy: float
    ) -> FloatArray:
        """As :meth:`solve_step`, from rest; the forces are now those after ``step``; collective."""
        self._step.array_w[:] = step[: self._owned]
        self.elasticity.mult(self._step, self._stretched)
        self._unbalanced.axpy(1.0, self._stretched)
        self._unbalanced_tools = (
            self._unbalanced_tools + self.system.tools.stiffnesses * step[self._owned :]
        )
        self._step.set(0.0)
        return self.solve_step(reactions, accuracy, is_rough=True)

    @property
    def filters(self) -> bool:
        """Whether the solver filters or projects what is stiff, at present."""
        return self._linear.filters

    @property
    def solves_following(self) -> bool:
        """Whether :meth:`solve_following` is there; a tool that presses excludes it."""
        return self._linear.solves_following and not self.system.tools.act

    def solve_following(
        self,
        reactions: Sequence[Reaction],
        follow: Callable[[FloatArray], Sequence[Reaction]],
        accuracy: float,
    ) -> FloatArray:
        """The step that balances reactions and those that follow the step itself; collective.

        ``follow`` finds these for a displacement step; they are linear in it.  Accuracy and start
        are those of :meth:`solve_step`.
        """

        def add_following(x: PETSc.Vec, y: PETSc.Vec) -> None:
            self._moved.set(0.0)
            # Contact multiplies by its stiffness the error of prescribed displacements in a solve.
            free = self.system.constraints.free_part(x.array_r)
            for reaction in follow(self._with_tools_at_rest(free)):
                reaction.add_to(self._moved)
            self.system.constraints.keep_free(self._moved)
            y.axpy(1.0, self._moved)

        self._find_residual(reactions)
        self._right.scale(-1.0)
        residual = accuracy * self.force_scale
        right = self._right.on_nodes
        self._linear.solve(right, self._step, residual, follow=add_following)
        return self._with_travels(self._step)

    def elastic_parts(
        self, accuracy: float, reactions: Sequence[Reaction]
    ) -> tuple[FloatArray, FloatArray]:
        """Steps by prescribed values, with given reactions, and by loads; collective.

        The first balances the elastic forces of the displacement visited last.
        """
        self._right.start(self._stretched, self._sprung)
        moved = self._solve_for(reactions, -1.0, accuracy)
        self._right.start(self._load, self.system.tools.forces)
        return moved, self._solve_for([], 1.0, accuracy)

    def balance(self, reactions: Sequence[Reaction], accuracy: float) -> FloatArray:
        """The displacement whose forces are those of the reactions; collective."""
        self._right.start()
        return self._solve_for(reactions, 1.0, accuracy)

    def answer(self, forces: FloatArray, accuracy: float) -> FloatArray:
        """The displacement for forces on owned dofs, and along travels behind them; collective."""
        self._right.start()
        self._right.on_nodes.array_w[:] = forces[: self._owned]
        self._right.on_tools = forces[self._owned :].copy()
        return self._solve_for([], 1.0, accuracy)

    def elastic_times(self, displacement: FloatArray) -> FloatArray:
        """The elastic forces on owned dofs and travels for a displacement; collective."""
        self._moved.array_w[:] = displacement[: self._owned]
        self.elasticity.mult(self._moved, self._whole)
        sprung = self.system.tools.stiffnesses * displacement[self._owned :]
        return np.append(self._whole.array_r, sprung)

    def forces(self, reactions: Sequence[Reaction]) -> FloatArray:
        """The forces of reactions on owned dofs, also held ones, and on travels; collective."""
        self._right.start()
        self._right.add_all(reactions)
        return np.append(self._right.on_nodes.array_r, self._right.on_tools)

    def left_unbalanced(self) -> float:
        """The sum of the nodal forces that the last :meth:`balance` leaves; collective."""
        self._linear.multiply(self._answer, self._moved)
        self._moved.axpy(-1.0, self._right.on_nodes)
        return float(self._moved.norm(PETSc.NormType.NORM_1))

    def respond(self, reactions: Sequence[Reaction], accuracy: float) -> FloatArray:
        """The displacement that answers a change of reactions; collective."""
        self._right.start()
        return self._solve_for(reactions, -1.0, accuracy, is_rough=True)

    def nothing(self) -> FloatArray:
        """A displacement step of zero."""
        return np.zeros(self._owned + len(self.system.tools))

    def present(self) -> FloatArray:
        """The system's displacement, for gaps that contain the travels of the tools."""
        return self._with_tools_at_rest(self.system.u.x.array[: self._owned])

    def trusted(self, t: float, step: FloatArray) -> float:
        """The length t, halved until the tangent foresees the forces of the body; collective.

        Along a step s with ``q = s . K s`` the slope of the convex energy of the body may be
        ``q/2`` above that of the tangent K, or the forces differ by less than the tolerance.  The
        full step of a body that nothing limits then at least halves the slope.
        """
        if self.is_linear:
            return t
        u, owned, most = self.system.u.x, step[: self._owned], self._tolerance * self.force_scale
        start, before = u.array.copy(), self._body_forces()
        self._moved.array_w[:] = owned
        self.elasticity.mult(self._moved, self._whole)
        foreseen = self._whole.array_r
        try:
            for _ in range(_HALVINGS):
                u.array[: self._owned] = start[: self._owned] + t * owned
                u.scatter_forward()
                above = self._body_forces() - before - t * foreseen
                local = np.array([above @ owned, foreseen @ owned, above @ above, owned @ owned])
                slope, square, distance, size = self.comm.allreduce(local)
                if square < -most * math.sqrt(size):
                    raise NotConverged("the energy of the body is not convex")
                # Beyond the strains for which there is an energy it is not a number.
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
        """Add ``t step`` to the system's displacement and to the travels; collective."""
        self.system.u.x.array[: self._owned] += t * step[: self._owned]
        self.system.u.x.scatter_forward()
        tools = self.system.tools
        tools.travels = tuple(np.add(tools.travels, t * step[self._owned :]))

    @property
    def direct(self) -> PETSc.KSP | None:
        """The direct solver of the tangents, if any."""
        return self._linear.direct

    def take_iterations(self) -> int:
        """The Krylov iterations since the last call."""
        return self._linear.take_iterations()

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._linear.destroy()
        self._border.destroy()
        owned = [self.matrix, self.elasticity, self._near_nullspace, self._right.on_nodes]
        for item in (*owned, *self._vectors):
            item.destroy()

    def stiff_part(self) -> StiffPart:
        """What is stiffer than the material by the factors of the tuning; collective."""
        tuning, is_linear = self._tuning, self.system.data.element.degree == 1
        along = tuning.stiff_along if is_linear else tuning.stiff_along_quadratic

        def assemble_rest(rest: PETSc.Mat) -> None:
            for family in self.families:
                family.soften(tuning.stiff, self._material)
            self._assemble(rest)

        def assemble_across(rest: PETSc.Mat) -> None:
            for family in self.families:
                family.soften_along(along, self._material)
            self._assemble(rest)

        return StiffPart(
            self._stiff_nodes(tuning.stiff),
            lambda: self._stiff_nodes(tuning.nearly_stiff),
            assemble_rest,
            lambda: self._stiff_rows(along),
            assemble_across,
        )

    def _stiff_rows(self, factor: float) -> tuple[PETSc.Mat, FloatArray]:
        """The rows of all families, without the part that is prescribed; collective."""
        found = [family.stiff_rows(factor, self._material) for family in self.families]
        rows = stacked([part for part, _ in found])
        free, constraints = self.matrix.createVecRight(), self.system.constraints
        free.array_w[:] = constraints.free_dofs()[: self._owned]
        rows.diagonalScale(None, free)
        free.destroy()
        rows = constraints.directions.projected_columns(rows)
        return rows, np.concatenate([stiffness for _, stiffness in found])

    def _stiff_nodes(self, factor: float) -> IndexArray:
        """The owned nodes with something free that are stiffer than the material; collective."""
        found = (family.stiff_nodes(factor, self._material) for family in self.families)
        nodes = functools.reduce(np.union1d, found)
        is_free = self.system.constraints.free_nodes()
        return nodes[is_free[nodes]].astype(np.int32)

    def _assemble(self, matrix: PETSc.Mat) -> None:
        blocks: dict[ContactNodes, FloatArray] = {}
        for family in self._touching:
            blocks[family.nodes] = blocks.get(family.nodes, 0.0) + family.tangent_block
        touching = [nodes.stiffness(block) for nodes, block in blocks.items()]
        self.system.constraints.assemble_matrix(self._form, matrix, touching)

    def _refresh_border(self) -> None:
        """Solve for the response to each travel; collective."""
        corner = np.diag(self.system.tools.stiffnesses)
        for number, column in enumerate(self._border.columns):
            travel = self.nothing()
            travel[self._owned + number] = 1.0
            pressed = [family for family in self.families if family.tool == number]
            reactions = [Reaction(family, family.block(family.see(travel))) for family in pressed]
            self._right.start()
            self._right.add(reactions)
            corner[:, number] += self._right.on_tools
            self._right.on_nodes.copy(column)
        self._border.refresh(
            corner,
            lambda right, answer: self._linear.solve(
                right, answer, _BORDER_ACCURACY * float(right.norm()), is_rough=True
            ),
        )

    def _with_travels(self, answer: PETSc.Vec) -> FloatArray:
        """The displacement with the travels for an answer without them; collective."""
        if not self.system.tools:
            return self.system.constraints.free_part(answer.array_r)
        answer.copy(self._whole)
        travels = self._border.solve(self._whole, self._right.on_tools)
        return np.append(self.system.constraints.free_part(self._whole.array_r), travels)

    def _with_tools_at_rest(self, owned: FloatArray) -> FloatArray:
        return np.append(owned, np.zeros(len(self.system.tools)))

    def _find_residual(self, reactions: Sequence[Reaction]) -> float:
        self._right.start(self._unbalanced, self._unbalanced_tools)
        return self._right.add(reactions)

    def _solve_for(
        self, reactions: Sequence[Reaction], sign: float, accuracy: float, is_rough: bool = False
    ) -> FloatArray:
        """Solve for ``sign`` times the right-hand side that there is with reactions added.

        An iterative solver leaves the share ``accuracy`` of it.
        """
        self._right.add(reactions)
        self._right.scale(sign)
        size = float(self._right.on_nodes.norm())
        self._answer.set(0.0)
        if size > 0.0:
            self._linear.solve(self._right.on_nodes, self._answer, accuracy * size, is_rough)
        return self._with_travels(self._answer)
