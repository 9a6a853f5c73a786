"""The discrete problem with multipliers: fields, residual and scaled tangent over PETSc."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from dolfinx.fem import petsc
from petsc4py import PETSc

from contact_locking import _compat, forms
from contact_locking.material import MANDEL_PAIRS, mandel_factor, strain
from contact_locking.solver.linear import create_ksp, default_options
from contact_locking.solver.report import Settings
from contact_locking.system import PenalisedSystem

FloatArray = npt.NDArray[np.float64]


class ConeSystem:
    """Strains, openings and slips of a displacement; forces of multipliers; the linear solver.

    Cells are those that can lock, owned by this rank; nodes are the owned nodes of Gamma_C.
    Strains and stresses of cells are Mandel vectors (k, m).
    """

    def __init__(self, system: PenalisedSystem, settings: Settings) -> None:
        self.system, data = system, system.data
        space = system.u.function_space
        mesh = space.mesh
        self.dim = mesh.topology.dim
        self.comm = system.comm
        scalars = fem.functionspace(mesh, ("DG", 0))
        self._tensors = fem.functionspace(mesh, ("DG", 0, (self.dim, self.dim)))
        owned = mesh.topology.index_map(self.dim).size_local
        dofs = scalars.dofmap.list.reshape(-1)[:owned]
        inverse_limit = data.inverse_limit.x.array[dofs]
        self._cells = dofs[inverse_limit > 0.0]
        self._cell_numbers = np.flatnonzero(inverse_limit > 0.0)
        self.limit = 1.0 / inverse_limit[inverse_limit > 0.0]
        self.volumes = fem.assemble_vector(fem.form(ufl.TestFunction(scalars) * data.dx)).array[
            self._cells
        ]
        self._strain = fem.Function(self._tensors)
        # One displacement at a time is looked at: the iterate or a step.
        self._seen = fem.Function(space)
        self._strain_of_seen = _compat.interpolation_expression(strain(self._seen), self._tensors)
        v, du = ufl.TestFunction(space), ufl.TrialFunction(space)
        self.stress = fem.Function(self._tensors, name="locking_stress")
        self._a, self._b = fem.Function(scalars), fem.Function(scalars)
        self._w = fem.Function(self._tensors)
        bound = system.bound
        self.surface = None if bound is None else bound.surface
        if self.surface is None:
            pressure = friction = stiffness = None
            slip = (None, None, None)
        else:
            nodal, vectors = self.surface.scalar_space, self.surface.vector_space
            pressure, friction = fem.Function(nodal), fem.Function(vectors)
            stiffness = fem.Function(nodal)
            slip = (fem.Function(nodal), fem.Function(nodal), fem.Function(vectors))
            self._find_nodes()
        self._pressure, self._friction = pressure, friction
        self._contact_stiffness, self._slip_stiffness = stiffness, slip
        internal = forms.internal_forces(
            system.u, v, data, self.stress, pressure, friction
        ) - forms.external_work(v, data)
        self._residual = fem.form(internal)
        locking = (self._a, self._b, self._w)
        self._tangent = fem.form(forms.scaled_tangent(v, du, data, locking, stiffness, slip))
        self.matrix = petsc.create_matrix(self._tangent)
        self.matrix.setOption(PETSc.Mat.Option.SPD, True)
        self._near_nullspace = system.near_nullspace()
        self.matrix.setNearNullSpace(self._near_nullspace)
        self._right, self._step = self.matrix.createVecLeft(), self.matrix.createVecRight()
        defaults = default_options(settings.linear, self.dim, system.size)
        self._ksp = create_ksp(self.matrix, defaults, settings.petsc)
        self._iterations = 0

    def describe_excess(self, strain: FloatArray) -> str:
        """Where, and by how much, strains (k, m) exceed their limit the most; collective."""
        ratio = np.linalg.norm(strain, axis=1) / self.limit
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

    def _find_nodes(self) -> None:
        """Leave out nodes whose normal displacement is prescribed: nothing is left to decide."""
        surface, contact = self.surface, self.system.data.contact
        assert surface is not None and contact is not None
        normal = contact.normal.x.array.reshape(-1, self.dim)[surface.blocks]
        is_free = self.system.free_dofs().reshape(-1, self.dim)[surface.blocks]
        self.active = np.linalg.norm(normal * is_free, axis=1) > 1e-6
        self.normal = normal[self.active]
        self._nodes, self._blocks = surface.nodes[self.active], surface.blocks[self.active]
        self.node_weights = surface.weights[self.active]
        self.node_gap = contact.gap.x.array[self._nodes]

    def at_all_nodes(self, values: FloatArray) -> FloatArray:
        """Values of the active nodes as values of all owned nodes of Gamma_C, zero elsewhere."""
        result = np.zeros((len(self.active), *values.shape[1:]))
        result[self.active] = values
        return result

    def look_at(self, displacement: FloatArray) -> None:
        """Choose the displacement (local values, ghosts included) that strains and slips are of."""
        self._seen.x.array[:] = displacement

    def strains(self) -> FloatArray:
        self._strain.interpolate(self._strain_of_seen)
        tensors = self._strain.x.array.reshape(-1, self.dim, self.dim)[self._cells]
        columns = [tensors[:, i, j] * mandel_factor(i, j) for i, j in self._pairs]
        return np.stack(columns, axis=1)

    def normal_displacement(self) -> FloatArray:
        return np.einsum("ki,ki->k", self._nodal(), self.normal)

    def slips(self) -> FloatArray:
        values = self._nodal()
        return values - np.einsum("ki,ki->k", values, self.normal)[:, None] * self.normal

    def set_scaling(
        self,
        locking: tuple[FloatArray, FloatArray, FloatArray],
        contact: FloatArray | None,
        friction: tuple[FloatArray, FloatArray, FloatArray] | None,
    ) -> None:
        """Assemble the tangent for the blocks ``D`` of cells and nodes."""
        a, b, w = locking
        self._a.x.array[self._cells], self._b.x.array[self._cells] = a, b
        self._set_tensors(self._w, w)
        for function in (self._a, self._b):
            function.x.scatter_forward()
        if contact is not None:
            self._set_nodal(self._contact_stiffness, contact)
        if friction is not None:
            for function, values in zip(self._slip_stiffness, friction, strict=True):
                self._set_nodal(function, values)
        self.matrix.zeroEntries()
        petsc.assemble_matrix(self.matrix, self._tangent, bcs=self.system.conditions)
        self.matrix.assemble()
        self._ksp.setOperators(self.matrix)

    def set_multipliers(
        self, stress: FloatArray, pressure: FloatArray | None, friction: FloatArray | None
    ) -> None:
        """``friction`` is ``-sigma_tau`` (k, d)."""
        self._set_tensors(self.stress, stress)
        if pressure is not None:
            self._set_nodal(self._pressure, pressure)
        if friction is not None:
            self._set_nodal(self._friction, friction)

    def residual_norm(self) -> float:
        """The equilibrium residual of the system's displacement with the multipliers set last."""
        self.system.assemble_free(self._residual, self._right)
        return float(self._right.norm())

    def solve_step(self) -> FloatArray:
        """The displacement step (local values) that the multipliers set last ask for."""
        self.system.assemble_free(self._residual, self._right)
        self._right.scale(-1.0)
        self._ksp.solve(self._right, self._step)
        self._iterations += self._ksp.getIterationNumber()
        return self.system.local_step(self._step)

    def take_iterations(self) -> int:
        """The Krylov iterations since the last call."""
        count, self._iterations = self._iterations, 0
        return count

    def destroy(self) -> None:
        for item in (self._ksp, self.matrix, self._near_nullspace, self._right, self._step):
            item.destroy()

    @property
    def _pairs(self) -> tuple[tuple[int, int], ...]:
        return MANDEL_PAIRS[self.dim]

    def _nodal(self) -> FloatArray:
        assert self.surface is not None
        return self._seen.x.array.reshape(-1, self.dim)[self._blocks]

    def _set_tensors(self, function: fem.Function, mandel: FloatArray) -> None:
        tensors = function.x.array.reshape(-1, self.dim, self.dim)
        for column, (i, j) in zip(mandel.T, self._pairs, strict=True):
            entry = column / mandel_factor(i, j)
            tensors[self._cells, i, j] = tensors[self._cells, j, i] = entry
        function.x.scatter_forward()

    def _set_nodal(self, function: fem.Function, values: FloatArray) -> None:
        if values.ndim == 1:
            function.x.array[self._nodes] = values
        else:
            function.x.array.reshape(-1, self.dim)[self._blocks] = values
        function.x.scatter_forward()
