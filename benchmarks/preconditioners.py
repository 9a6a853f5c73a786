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
from types import SimpleNamespace

import numpy as np
from dolfinx import fem
from dolfinx.fem import petsc
from locked_cube import Body
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse import diags

from contact_locking.problem.system import near_nullspace
from contact_locking.solver.ksp import IN_BLOCKS
from contact_locking.solver.multigrid import FilteredMultigrid, StiffPart

PLACES = ("half", "scattered")
DIRECTIONS = ("same", "random")
METHODS = ("projection", "filter", "BDDC", "GAMG")
_MOST = 400
_NO_LIMIT = 10**9


@dataclass(frozen=True)
class Outcome:
    """CG iterations, none where CG did not end, and the seconds of set-up and solve."""

    iterations: int | None
    set_up: float
    solve: float

    def __str__(self) -> str:
        count = f"> {_MOST}" if self.iterations is None else str(self.iterations)
        return f"{count} ({self.set_up:.1f} + {self.solve:.1f} s)"


def context(multigrid: FilteredMultigrid) -> SimpleNamespace:
    """What PETSc calls for a preconditioner of type python."""
    return SimpleNamespace(apply=lambda pc, r, z: multigrid.apply(r, z))


def by_package(body: Body, limit: int) -> Outcome:
    """The filter up to ``limit`` unknowns, the projection above."""
    matrix = petsc.create_matrix(body.form(), IN_BLOCKS)
    motions = near_nullspace(matrix.createVecRight(), body.space)
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
        pc.setPythonContext(context(multigrid))
        multigrid.refresh(stiff)

    outcome = solved(body, matrix, prepare)
    motions.destroy()
    return outcome


def by_gamg(body: Body) -> Outcome:
    """Algebraic multigrid with the package's own options."""
    matrix = petsc.create_matrix(body.form(), IN_BLOCKS)
    motions = near_nullspace(matrix.createVecRight(), body.space)
    matrix.setNearNullSpace(motions)
    petsc.assemble_matrix(matrix, body.form(), bcs=[body.clamped])
    matrix.assemble()
    multigrid = FilteredMultigrid(matrix, 0)

    def prepare(pc: PETSc.PC) -> None:
        pc.setType(PETSc.PC.Type.PYTHON)
        pc.setPythonContext(context(multigrid))
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
    motions = near_nullspace(matrix.createVecRight(), space)
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


def solved(body: Body, matrix: PETSc.Mat, prepare: Callable[[PETSc.PC], None]) -> Outcome:
    """Set up what ``prepare`` chooses, and solve by CG."""
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
