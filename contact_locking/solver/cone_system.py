"""The discrete problem with multipliers: strains, forces and the scaled tangent over PETSc."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la
from dolfinx import mesh as dmesh
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking import compiled, forms
from contact_locking.material import MANDEL_PAIRS, mandel_factor, strain
from contact_locking.solver.filtered_multigrid import StiffPart
from contact_locking.solver.linear import is_direct
from contact_locking.solver.multipliers import ContactForces, Multipliers
from contact_locking.solver.report import Settings
from contact_locking.solver.storage import IN_BLOCKS
from contact_locking.solver.strain_operator import StrainOperator
from contact_locking.solver.tangent_solver import TangentSolver
from contact_locking.system import PenalisedSystem

FloatArray = npt.NDArray[np.float64]

# Cells stiffer than the material, and than the softest, by this factor go into the filter, and
# nodes of Gamma_C that are held as stiffly, which save half of the iterations in the end.
_STIFF = 10.0
# What is stiffer than this comes along, as most of it gets stiff later.
_NEARLY_STIFF = 0.5


class ConeSystem:
    """Strains and slips of a displacement; forces of multipliers; the linear solver.

    Cells are those that can lock, owned by this rank; nodes are the owned nodes of Gamma_C whose
    normal displacement is free.  Strains and stresses are Mandel vectors (m, k), vectors at nodes
    (d, k).  What is asked for at the system's displacement, ``visit`` evaluates.
    """

    def __init__(self, system: PenalisedSystem, settings: Settings, stiffness: float) -> None:
        self.system, data = system, system.data
        self._stiffness, self._tolerance = stiffness, settings.tolerance
        space = system.u.function_space
        mesh = space.mesh
        self.dim = mesh.topology.dim
        self.comm = system.comm
        self._owned = space.dofmap.index_map.size_local * space.dofmap.index_map_bs
        self._free = system.free_dofs()[: self._owned]
        self.energy = self.force_scale = 0.0
        scalars = fem.functionspace(mesh, ("DG", 0))
        owned_cells = mesh.topology.index_map(self.dim).size_local
        # Degrees of freedom of P0 spaces, in which cells need not be numbered as in the mesh.
        dofs = scalars.dofmap.list.reshape(-1)[:owned_cells]
        inverse_limit = data.inverse_limit.x.array[dofs]
        self._cells, self._cell_numbers = dofs[inverse_limit > 0.0], np.flatnonzero(inverse_limit)
        self.limit = 1.0 / inverse_limit[self._cell_numbers]
        self._operator = StrainOperator(space, data.dx, self._cells)
        self.volumes = self._operator.volumes
        self.rows = len(MANDEL_PAIRS[self.dim])
        self._a, self._b = fem.Function(scalars), fem.Function(scalars)
        self._tensors = fem.functionspace(mesh, ("DG", 0, (self.dim, self.dim)))
        self._w = fem.Function(self._tensors)
        bound = system.bound
        self.surface = None if bound is None else bound.surface
        contact: fem.Function | None = None
        slip: tuple[Any, Any, Any] = (None, None, None)
        if self.surface is not None:
            nodal, vectors = self.surface.scalar_space, self.surface.vector_space
            contact = fem.Function(nodal)
            slip = (fem.Function(nodal), fem.Function(nodal), fem.Function(vectors))
            self._find_nodes()
        self._contact_stiffness, self._slip_stiffness = contact, slip
        v, du = ufl.TestFunction(space), ufl.TrialFunction(space)
        locking = (self._a, self._b, self._w)
        self._tangent = compiled.form(forms.scaled_tangent(v, du, data, locking, contact, slip))
        factorises = is_direct(settings.linear, self.dim, system.size)
        self.matrix = petsc.create_matrix(self._tangent, IN_BLOCKS)
        self._near_nullspace = system.near_nullspace()
        self.matrix.setNearNullSpace(self._near_nullspace)
        self._elasticity = petsc.assemble_matrix(compiled.form(forms.elastic_form(du, v, data)))
        self._elasticity.assemble()
        vectors = [self.matrix.createVecRight() for _ in range(7)]
        self._load, self._stretched, self._unbalanced, self._right = vectors[:4]
        self._step, self._answer, self._seen = vectors[4:]
        self._load.array_w[:] = system.load
        self._linear = TangentSolver(self.matrix, self.dim, settings, factorises)

    def visit(self) -> None:
        """Evaluate the elastic forces and the energy of the system's displacement; collective."""
        self._seen.array_w[:] = self.system.u.x.array[: self._owned]
        self._elasticity.mult(self._seen, self._stretched)
        self.energy = 0.5 * float(self._stretched.dot(self._seen))
        acting = max(self._load.norm(), self._stretched.norm())
        self.force_scale = self.system.above_rounding(float(acting), self._tolerance)
        self._unbalanced.waxpy(-1.0, self._load, self._stretched)

    def strains(self, displacement: FloatArray) -> FloatArray:
        """``eps`` (m, k) of a displacement (owned values); collective."""
        self._seen.array_w[:] = displacement[: self._owned]
        return self._operator.strains(self._seen)

    def normal_displacements(self, displacement: FloatArray) -> FloatArray:
        """``u_nu`` (k,)."""
        return np.einsum("ik,ik->k", self._nodal(displacement), self.normal)

    def slips(self, displacement: FloatArray) -> FloatArray:
        """``u_tau`` (d, k)."""
        values = self._nodal(displacement)
        # Once more, as rounding leaves a normal part that the stiffness of sticking enlarges.
        for _ in range(2):
            values = values - np.einsum("ik,ik->k", values, self.normal) * self.normal
        return values

    def set_scaling(
        self,
        locking: tuple[FloatArray, FloatArray, FloatArray],
        contact: FloatArray | None,
        friction: tuple[FloatArray, FloatArray, FloatArray] | None,
    ) -> None:
        """Assemble the tangent for the blocks ``D`` of cells and nodes."""
        self._set_tensors(self._w, locking[2])
        self._w.x.scatter_forward()
        if contact is not None:
            self._set_nodal(self._contact_stiffness, contact)
        if friction is not None:
            for function, values in zip(self._slip_stiffness, friction, strict=True):
                self._set_nodal(function, values)
        self._assemble(self.matrix, *locking[:2])

        def split() -> StiffPart:
            stiffness = self._relative_stiffness(*locking)
            a, b = (np.where(stiffness > _STIFF, 0.0, values) for values in locking[:2])

            def nodes(factor: float) -> npt.NDArray[np.int32]:
                of_cells = self._nodes_of(self._cell_numbers[stiffness > factor])
                return np.union1d(of_cells, self._held_nodes(factor, contact, friction))

            return StiffPart(
                nodes(_STIFF),
                lambda: nodes(_NEARLY_STIFF),
                lambda soft: self._assemble(soft, a, b),
            )

        self._linear.refresh(split)
        self._step.set(0.0)

    def residual_norm(
        self, stress: FloatArray, pressure: FloatArray | None, friction: FloatArray | None
    ) -> float:
        """``|a(u, .) + (Z, eps(.)) + int p v_nu - sigma_tau . v_tau - (f, .)|`` over free dofs.

        ``u`` is the displacement visited last, ``friction`` is ``-sigma_tau`` (d, k); collective.
        """
        self._find_residual(stress, pressure, friction)
        return float(self._right.norm())

    def solve_step(
        self,
        stress: FloatArray,
        pressure: FloatArray | None,
        friction: FloatArray | None,
        accuracy: float = 0.0,
    ) -> FloatArray:
        """The displacement step (owned values) that balances these multipliers; collective.

        An iterative solver leaves a residual of ``accuracy``, relative to the forces, at most, and
        starts from the step before, if that was for the same scaling.
        """
        self._find_residual(stress, pressure, friction)
        self._right.scale(-1.0)
        self._linear.solve(self._right, self._step, accuracy * self.force_scale)
        return self._step.array_r * self._free

    def elastic_parts(
        self, accuracy: float, pressure: FloatArray | None
    ) -> tuple[FloatArray, FloatArray]:
        """Steps (owned values) with the tangent that is set: by prescribed values, by loads.

        The first balances the elastic forces of the displacement visited last, and a pressure; an
        iterative solver leaves the share ``accuracy`` of either; collective.
        """
        parts = []
        for vector in (self._stretched, self._load):
            vector.copy(self._right)
            # PETSc keeps the norm of a vector until the array is given back.
            with self._right as right:
                if vector is self._stretched:
                    if pressure is not None:
                        traction = (self.node_weights * pressure * self.normal).T
                        right.reshape(-1, self.dim)[self._blocks] += traction
                    right *= -1.0
                right *= self._free
            size = float(self._right.norm())
            self._answer.set(0.0)
            if size > 0.0:
                self._linear.solve(self._right, self._answer, accuracy * size)
            parts.append(self._answer.array_r * self._free)
        return parts[0], parts[1]

    def balance(
        self, stress: FloatArray, pressure: FloatArray | None, accuracy: float
    ) -> FloatArray:
        """The displacement (owned values) whose forces, with the tangent that is set, are those.

        An iterative solver leaves the share ``accuracy`` of the forces; collective.
        """
        self._right.set(0.0)
        self._add_multipliers(stress, pressure, None)
        self._answer.set(0.0)
        self._linear.solve(self._right, self._answer, accuracy * float(self._right.norm()))
        return self._answer.array_r * self._free

    def respond(self, friction: FloatArray, accuracy: float) -> FloatArray:
        """The displacement (owned values) that answers a change of ``-sigma_tau`` (d, k).

        An iterative solver leaves the share ``accuracy`` of the change; collective.
        """
        with self._right as right:
            right[:] = 0.0
            right.reshape(-1, self.dim)[self._blocks] -= (self.node_weights * friction).T
            right *= self._free
        self._answer.set(0.0)
        residual = accuracy * float(self._right.norm())
        self._linear.solve(self._right, self._answer, residual, is_rough=True)
        return self._answer.array_r * self._free

    def move(self, t: float, step: FloatArray) -> None:
        """Add ``t step`` (owned values) to the system's displacement; collective."""
        self.system.u.x.array[: self._owned] += t * step
        self.system.u.x.scatter_forward()

    @property
    def direct(self) -> PETSc.KSP | None:
        """What factorises the tangents, for others, until this is destroyed."""
        return self._linear.direct

    def largest_displacement(self) -> float:
        """The largest component of the system's displacement; collective."""
        local = float(np.max(np.abs(self.system.u.x.array), initial=0.0))
        return float(self.comm.allreduce(local, op=MPI.MAX))

    def take_iterations(self) -> int:
        """The Krylov iterations since the last call."""
        return self._linear.take_iterations()

    def multipliers(
        self,
        stress: FloatArray,
        pressure: FloatArray | None,
        friction: FloatArray | None,
        touches: npt.NDArray[np.bool_] | None,
    ) -> Multipliers:
        """Them as functions and values at all owned nodes of Gamma_C; collective."""
        field = fem.Function(self._tensors, name="locking_stress")
        self._set_tensors(field, stress)
        field.x.scatter_forward()
        count = 0 if self.surface is None else len(self.surface.nodes)
        every = np.zeros(count), np.zeros((count, self.dim)), np.zeros(count, dtype=bool)
        if pressure is not None:
            every[0][self.active] = pressure
        if friction is not None:
            every[1][self.active] = friction.T
        if touches is not None:
            every[2][self.active] = touches
        return Multipliers(field, (ContactForces(*every),) if self.surface is not None else ())

    def at_all_nodes(self, values: FloatArray) -> FloatArray:
        """Values (k,) at the nodes as values at all owned nodes of Gamma_C, zero elsewhere."""
        result = np.zeros(len(self.active))
        result[self.active] = values
        return result

    def power(
        self,
        displacement: FloatArray,
        stress: FloatArray,
        pressure: FloatArray | None,
    ) -> float:
        """``int Z : eps(u) + int p u_nu``; collective."""
        local = float(self.volumes @ np.sum(stress * self.strains(displacement), axis=0))
        if pressure is not None:
            local += float(self.node_weights @ (pressure * self.normal_displacements(displacement)))
        return float(self.comm.allreduce(local))

    def resistance(self, stress: FloatArray, pressure: FloatArray | None) -> float:
        """``int M |Z| + int gap p``: the most that :meth:`power` can be where it is admissible."""
        local = float(self.volumes @ (self.limit * np.linalg.norm(stress, axis=0)))
        if pressure is not None:
            local += float(self.node_weights @ (self.node_gap * pressure))
        return float(self.comm.allreduce(local))

    def work_beyond(self, displacement: FloatArray, unlimited: float) -> float:
        """``int c |eps(v)| (M + |eps(u)|)`` of ``v`` (owned values), u being the system's.

        c is the largest eigenvalue of A, and ``unlimited`` takes the place of an infinite M;
        collective.
        """
        space = self.system.u.function_space
        v = fem.Function(space)
        v.x.array[: self._owned] = displacement[: self._owned]
        v.x.scatter_forward()
        data = self.system.data
        limit = 1.0 / ufl.max_value(data.inverse_limit, 1e-300)
        limit = ufl.conditional(ufl.gt(data.inverse_limit, 0.0), limit, unlimited)
        sizes = [ufl.sqrt(ufl.inner(strain(w), strain(w))) for w in (v, self.system.u)]
        form = data.largest_eigenvalue * sizes[0] * (limit + sizes[1]) * data.dx
        return float(self.comm.allreduce(fem.assemble_scalar(compiled.form(form))))

    def describe_excess(self, strains: FloatArray) -> str:
        """Where, and by how much, strains (m, k) exceed their limit the most; collective."""
        ratio = np.linalg.norm(strains, axis=0) / self.limit
        found: tuple[float, list[float]] = (0.0, [])
        if len(ratio):
            worst = int(np.argmax(ratio))
            cell = np.array([self._cell_numbers[worst]], dtype=np.int32)
            mesh = self.system.u.function_space.mesh
            place = dmesh.compute_midpoints(mesh, self.dim, cell)[0, : self.dim]
            found = float(ratio[worst]), place.tolist()
        largest, place = max(self.comm.allgather(found))
        if largest <= 1.0:
            return "the foundation is in the way"
        at = ", ".join(f"{x:.3g}" for x in place)
        return f"the strain is forced to {largest:.2g} times its limit near ({at})"

    def destroy(self) -> None:
        """Free the PETSc objects; collective."""
        self._operator.destroy()
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
            self._seen,
        ):
            item.destroy()

    def _assemble(self, matrix: PETSc.Mat, a: FloatArray, b: FloatArray) -> None:
        self._a.x.array[self._cells], self._b.x.array[self._cells] = a, b
        self._a.x.scatter_forward()
        self._b.x.scatter_forward()
        matrix.zeroEntries()
        petsc.assemble_matrix(matrix, self._tangent, bcs=self.system.conditions)
        matrix.assemble()

    def _relative_stiffness(self, a: FloatArray, b: FloatArray, w: FloatArray) -> FloatArray:
        """How much stiffer cells are than the material, and than the softest; collective."""
        stiffness = a + np.maximum(b, 0.0) * np.sum(w**2, axis=0)
        least = self.comm.allreduce(float(np.min(stiffness, initial=np.inf)), op=MPI.MIN)
        return np.asarray(stiffness / max(self._stiffness, least))

    def _held_nodes(
        self,
        factor: float,
        contact: FloatArray | None,
        friction: tuple[FloatArray, FloatArray, FloatArray] | None,
    ) -> npt.NDArray[np.int32]:
        """The owned nodes that contact or friction holds as much more stiffly than the material."""
        if contact is None:
            return np.empty(0, dtype=np.int32)
        springs = contact if friction is None else np.maximum(contact, friction[0])
        spacing = self.node_weights ** (1.0 / (self.dim - 1))
        return self._blocks[springs * spacing > factor * self._stiffness]

    def _nodes_of(self, cells: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
        """The owned nodes of owned cells, of all ranks, with something free; collective."""
        touched = fem.Function(self.system.u.function_space)
        blocks = touched.function_space.dofmap.list[cells]
        touched.x.array.reshape(-1, self.dim)[blocks.reshape(-1)] = 1.0
        touched.x.scatter_reverse(la.InsertMode.add)
        is_touched = touched.x.array[: self._owned] * self._free
        return np.flatnonzero(is_touched.reshape(-1, self.dim).any(axis=1)).astype(np.int32)

    def _find_nodes(self) -> None:
        """Leave out nodes whose normal displacement is prescribed: nothing is left to decide."""
        surface, contact = self.surface, self.system.data.contact
        assert surface is not None and contact is not None
        normal = contact.normal.x.array.reshape(-1, self.dim)[surface.blocks]
        self.active: npt.NDArray[Any] = surface.free_nodes(normal, self._free)
        self.normal = np.ascontiguousarray(normal[self.active].T)
        self._nodes, self._blocks = surface.nodes[self.active], surface.blocks[self.active]
        self.node_weights = surface.weights[self.active]
        self.node_gap = contact.gap.x.array[self._nodes]

    def _find_residual(
        self, stress: FloatArray, pressure: FloatArray | None, friction: FloatArray | None
    ) -> None:
        self._unbalanced.copy(self._right)
        self._add_multipliers(stress, pressure, friction)

    def _add_multipliers(
        self, stress: FloatArray, pressure: FloatArray | None, friction: FloatArray | None
    ) -> None:
        self._operator.add_forces(stress, self._right)
        right = self._right.array_w
        if pressure is not None:
            traction = pressure * self.normal
            if friction is not None:
                traction += friction
            right.reshape(-1, self.dim)[self._blocks] += (self.node_weights * traction).T
        right *= self._free

    def _nodal(self, displacement: FloatArray) -> FloatArray:
        return displacement[: self._owned].reshape(-1, self.dim)[self._blocks].T

    def _set_tensors(self, function: fem.Function, mandel: FloatArray) -> None:
        tensors = function.x.array.reshape(-1, self.dim, self.dim)
        for row, (i, j) in zip(mandel, MANDEL_PAIRS[self.dim], strict=True):
            tensors[self._cells, i, j] = tensors[self._cells, j, i] = row / mandel_factor(i, j)

    def _set_nodal(self, function: fem.Function, values: FloatArray) -> None:
        if values.ndim == 1:
            function.x.array[self._nodes] = values
        else:
            function.x.array.reshape(-1, self.dim)[self._blocks] = values.T
        function.x.scatter_forward()
