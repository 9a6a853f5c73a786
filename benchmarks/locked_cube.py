"""The unit cube with locked cells of any contrast: its forms, its clamped end, random waves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la, mesh
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import BoolArray, FloatArray


@dataclass(frozen=True)
class Body:
    """The cube with its locked cells: the forms with and without what locks, and the clamped end.

    ``beta`` and ``w`` are functions with constants in each cell.
    """

    space: fem.FunctionSpace
    beta: fem.Function
    w: fem.Function
    clamped: fem.DirichletBC

    @classmethod
    def of(cls, cells: int, where: str, direction: str, stiffness: float) -> Body:
        """The cube with ``cells`` cells a side; collective."""
        # BDDC's subdomains are the cells of the ranks, without ghosts.
        cube = mesh.create_unit_cube(
            MPI.COMM_WORLD, cells, cells, cells, ghost_mode=mesh.GhostMode.none
        )
        space = fem.functionspace(cube, ("P", 1, (3,)))
        beta = fem.Function(fem.functionspace(cube, ("DG", 0)))
        w = fem.Function(fem.functionspace(cube, ("DG", 0, (3, 3))))
        count = cube.topology.index_map(3).size_local
        # The same numbers for a cell on any number of ranks.
        original = cube.topology.original_cell_index[:count]
        generator = np.random.default_rng(1)
        total = 6 * cells**3
        scattered, tensors = (
            generator.random(total) < 0.25,
            generator.standard_normal((total, 3, 3)),
        )
        if direction == "same":
            tensors[:] = tensors[0]
        tensors += tensors.transpose(0, 2, 1).copy()
        tensors /= np.linalg.norm(tensors, axis=(1, 2))[:, None, None]
        middles = mesh.compute_midpoints(cube, 3, np.arange(count, dtype=np.int32))
        locked = middles[:, 0] < 0.5 if where == "half" else scattered[original]
        beta.x.array[:count] = np.where(locked, stiffness, 0.0)
        w.x.array.reshape(-1, 3, 3)[:count] = tensors[original]
        end = fem.locate_dofs_geometrical(space, lambda x: np.isclose(x[0], 0.0))
        clamped = fem.dirichletbc(np.zeros(3), end, space)
        return cls(space, beta, w, clamped)

    @property
    def locked(self) -> BoolArray:
        """The owned cells that are locked."""
        return np.asarray(self.beta.x.array > 0.0)

    def form(self, is_whole: bool = True) -> fem.Form:
        """The bilinear form (E = 1, nu = 0.3), without what locks if it is not whole."""
        u, v = ufl.TrialFunction(self.space), ufl.TestFunction(self.space)
        eps, eps_v = ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(v))
        mu, lam = 1.0 / 2.6, 0.3 / (1.3 * 0.4)
        stress = 2.0 * mu * eps + lam * ufl.tr(eps) * ufl.Identity(3)
        elastic = ufl.inner(stress, eps_v)
        along = self.beta * ufl.inner(self.w, eps) * ufl.inner(self.w, eps_v)
        return fem.form((elastic + along if is_whole else elastic) * ufl.dx)

    def free(self) -> FloatArray:
        """1 at free and 0 at clamped local degrees of freedom."""
        mask = np.ones(len(self.right_hand_side()))
        mask[self.clamped.dof_indices()[0]] = 0.0
        return mask

    def right_hand_side(self) -> FloatArray:
        """Sums of random waves at the local nodes, the same for any number of ranks."""
        generator = np.random.default_rng(2)
        x = self.space.tabulate_dof_coordinates()
        waves, phases = 40.0 * generator.standard_normal((3, 8, 3)), generator.random((3, 8))
        return np.sin(np.einsum("cks,ns->nck", waves, x) + 7.0 * phases).sum(axis=2).reshape(-1)

    def rows(self) -> tuple[PETSc.Mat, FloatArray]:
        """C, the integrals of ``w : eps`` over locked cells, and the diagonal of B; collective."""
        u, q = ufl.TrialFunction(self.space), ufl.TestFunction(self.beta.function_space)
        every = petsc.assemble_matrix(
            fem.form(ufl.inner(self.w, ufl.sym(ufl.grad(u))) * q * ufl.dx)
        )
        every.assemble()
        volumes = fem.assemble_vector(fem.form(q * ufl.dx)).array
        first = every.getOwnershipRange()[0]
        locked = np.flatnonzero(self.locked)
        chosen = PETSc.IS().createGeneral((first + locked).astype(PETSc.IntType), every.getComm())
        rows = every.createSubMatrix(chosen, None)
        free = rows.createVecRight()
        free.array_w[:] = self.free()[: free.getLocalSize()]
        rows.diagonalScale(None, free)
        for item in (every, chosen, free):
            item.destroy()
        return rows, (self.beta.x.array / volumes)[locked]

    def locked_nodes(self) -> npt.NDArray[np.int32]:
        """The owned nodes of locked cells that are not clamped; collective."""
        touched = la.vector(self.space.dofmap.index_map, 1)
        touched.array[self.space.dofmap.list[np.flatnonzero(self.locked)].reshape(-1)] = 1.0
        touched.scatter_reverse(la.InsertMode.add)
        owned = self.space.dofmap.index_map.size_local
        is_free = self.free().reshape(-1, 3)[:owned, 0] > 0.0
        return np.flatnonzero((touched.array[:owned] > 0.0) & is_free).astype(np.int32)
