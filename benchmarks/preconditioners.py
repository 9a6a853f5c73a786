"""Compare preconditioners of a body with locked cells of any contrast, on every rank of mpirun.

    ./in-env mpirun -n 4 python3 -m mpi4py benchmarks/preconditioners.py --cells 14
    ./in-env mpirun -n 8 python3 -m mpi4py benchmarks/preconditioners.py --cells 16 --threshold 3

Linear elasticity of the unit cube, P1 on a regular grid, clamped at x = 0, with ``beta (w:eps)^2``
in half of the cells or in a scattered quarter; CG from zero to 1e-4 of a right-hand side of random
waves, in the norm of the residual.  w is the same unit tensor in all these cells, or random in
each.  The preconditioners are the projection and the filter of the package, PETSc's adaptive BDDC
with deluxe scaling, one subdomain for each rank, and GAMG alone.  Where BDDC breaks down on one
rank, mpi4py ends the others.  Times are by the clock on the wall, and mean nothing where there are
more ranks than cores.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem, la, mesh
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import diags

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.problem.near_nullspace import near_nullspace
from contact_locking.solver.linear.filtered_multigrid import FilteredMultigrid, StiffPart
from contact_locking.solver.linear.storage import IN_BLOCKS

PLACES = ("half", "scattered")
DIRECTIONS = ("same", "random")
METHODS = ("projection", "filter", "BDDC", "GAMG")
_MOST = 400
_NO_LIMIT = 10**9


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


@dataclass(frozen=True)
class Outcome:
    """CG iterations, none where CG did not end, and the seconds of set-up and solve."""

    iterations: int | None
    set_up: float
    solve: float

    def __str__(self) -> str:
        count = f"> {_MOST}" if self.iterations is None else str(self.iterations)
        return f"{count} ({self.set_up:.1f} + {self.solve:.1f} s)"


def by_package(body: Body, limit: int) -> Outcome:
    """The filter up to ``limit`` unknowns, the projection above."""
    matrix = petsc.create_matrix(body.form(), IN_BLOCKS)
    motions = near_nullspace(fem.Function(body.space))
    matrix.setNearNullSpace(motions)
    soft_form = body.form(is_whole=False)

    def assemble(into: PETSc.Mat, form: fem.Form) -> None:
        into.zeroEntries()
        petsc.assemble_matrix(into, form, bcs=[body.clamped])
        into.assemble()

    assemble(matrix, body.form())
    nodes = body.locked_nodes()
    stiff = StiffPart(
        nodes,
        lambda: nodes,
        lambda into: assemble(into, soft_form),
        body.rows,
        lambda into: assemble(into, soft_form),
    )
    multigrid = FilteredMultigrid(matrix, limit)

    def prepare(pc: PETSc.PC) -> None:
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(multigrid)
        multigrid.refresh(stiff)

    outcome = solved(body, matrix, prepare, multigrid.start)
    motions.destroy()
    return outcome


def by_gamg(body: Body) -> Outcome:
    """Algebraic multigrid with the package's own options."""
    matrix = petsc.create_matrix(body.form(), IN_BLOCKS)
    motions = near_nullspace(fem.Function(body.space))
    matrix.setNearNullSpace(motions)
    petsc.assemble_matrix(matrix, body.form(), bcs=[body.clamped])
    matrix.assemble()
    multigrid = FilteredMultigrid(matrix, 0)

    def prepare(pc: PETSc.PC) -> None:
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(multigrid)
        multigrid.refresh()

    outcome = solved(body, matrix, prepare)
    motions.destroy()
    return outcome


def by_bddc(body: Body, threshold: float) -> Outcome:
    """PETSc's adaptive BDDC, each rank a subdomain."""
    space = body.space
    index_map, size = space.dofmap.index_map, space.dofmap.index_map_bs
    count = index_map.size_local + index_map.num_ghosts
    numbers = index_map.local_to_global(np.arange(count, dtype=np.int32)).astype(PETSc.IntType)
    # DOLFINx puts this map on one rank, where BDDC finds no interface.
    local_to_global = PETSc.LGMap().create(numbers, bsize=size, comm=space.mesh.comm)
    # The rows of a rank are those of its cells alone until ghosts are added.
    rows = fem.assemble_matrix(body.form()).to_scipy(ghosted=True).tocsr()
    rows = rows[:, : rows.shape[0]]
    inside = diags(body.free())
    rows = (inside @ rows @ inside + diags(1.0 - body.free())).tocsr()
    local = PETSc.Mat().createAIJ(
        rows.shape, csr=(rows.indptr, rows.indices, rows.data), comm=PETSc.COMM_SELF
    )
    sizes = (size * index_map.size_local, size * index_map.size_global)
    matrix = PETSc.Mat().createIS(
        (sizes, sizes), lgmapr=local_to_global, lgmapc=local_to_global, comm=space.mesh.comm
    )
    matrix.setISLocalMat(local)
    matrix.assemble()
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    motions = near_nullspace(fem.Function(space))
    matrix.setNearNullSpace(motions)
    options = PETSc.Options("bddc_")
    given = {
        "pc_bddc_monolithic": None,
        "pc_bddc_use_faces": None,
        "pc_bddc_vertex_size": 3,
        # Without it subdomains that touch no clamped node stay free to move.
        "pc_bddc_corner_selection": None,
        "pc_bddc_use_deluxe_scaling": None,
        "pc_bddc_adaptive_threshold": threshold,
    }
    for name, value in given.items():
        options.setValue(name, value)

    def prepare(pc: PETSc.PC) -> None:
        pc.setType(PETSc.PC.Type.BDDC)
        x = space.tabulate_dof_coordinates()[: index_map.size_local]
        pc.setCoordinates(np.repeat(x, size, axis=0))

    outcome = solved(body, matrix, prepare)
    for name in given:
        options.delValue(name)
    motions.destroy()
    return outcome


def solved(
    body: Body,
    matrix: PETSc.Mat,
    prepare: Callable[[PETSc.PC], None],
    start: Callable[[PETSc.Vec, PETSc.Vec], None] | None = None,
) -> Outcome:
    """Set up what ``prepare`` chooses, and solve by CG from what ``start`` makes of zero."""
    right, x = matrix.createVecs()
    owned = right.getLocalSize()
    right.array_w[:] = (body.right_hand_side() * body.free())[:owned]
    ksp = PETSc.KSP().create(matrix.getComm())
    ksp.setOptionsPrefix("bddc_")
    ksp.setOperators(matrix)
    ksp.setType(PETSc.KSP.Type.CG)
    ksp.setNormType(PETSc.KSP.NormType.UNPRECONDITIONED)
    ksp.setTolerances(rtol=1e-4, max_it=_MOST)
    matrix.getComm().tompi4py().Barrier()
    began = time.perf_counter()
    prepare(ksp.getPC())
    ksp.setFromOptions()
    ksp.setUp()
    ready = time.perf_counter()
    if start is not None:
        start(right, x)
        ksp.setInitialGuessNonzero(True)
    ksp.solve(right, x)
    ended = time.perf_counter()
    count = ksp.getIterationNumber() if ksp.getConvergedReason() > 0 else None
    for item in (ksp, right, x, matrix):
        item.destroy()
    return Outcome(count, ready - began, ended - ready)


def main() -> None:
    """Print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=14, help="cells a side")
    parser.add_argument("--threshold", type=float, default=1.1, help="of adaptive BDDC")
    parser.add_argument("--beta", type=float, nargs="+", default=[1e4, 1e6, 1e8])
    parser.add_argument("--where", choices=PLACES, nargs="+", default=PLACES)
    parser.add_argument("--direction", choices=DIRECTIONS, nargs="+", default=DIRECTIONS)
    parser.add_argument("--methods", choices=METHODS, nargs="+", default=METHODS[:3])
    given = parser.parse_args()
    every: dict[str, Callable[[Body], Outcome]] = {
        "projection": lambda body: by_package(body, 0),
        "filter": lambda body: by_package(body, _NO_LIMIT),
        "BDDC": lambda body: by_bddc(body, given.threshold),
        "GAMG": by_gamg,
    }
    methods = {name: every[name] for name in given.methods}
    is_first = MPI.COMM_WORLD.rank == 0
    if is_first:
        print(
            f"{given.cells} cells a side, {MPI.COMM_WORLD.size} ranks, CG to 1e-4, "
            f"BDDC with the threshold {given.threshold:g}"
        )
        print("| " + " | ".join(["where", "w", "beta", *methods]) + " |")
        print("| --- " * (3 + len(methods)) + "|", flush=True)
    for where in given.where:
        for direction in given.direction:
            for beta in given.beta:
                body = Body.of(given.cells, where, direction, beta)
                found = [str(method(body)) for method in methods.values()]
                if is_first:
                    print("| " + " | ".join([where, direction, f"{beta:g}", *found]) + " |",
                          flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
