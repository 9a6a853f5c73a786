"""The block of the tests on a regular grid, solved and timed beside one elastic solve."""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import ufl
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.fem import compiled
from contact_locking.problem import forms
from contact_locking.problem.system import System
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.assembly import assemble
from contact_locking.solver.ksp import create_ksp, default_options, destroy_ksp
from contact_locking.study_file.parameters import Parameters

# The reference problem belongs to the tests.
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
from problems import block
from stopwatch import Stopwatch


@dataclass(frozen=True)
class Run:
    """One solve: ``seconds`` of the nonlinear solver, ``total`` from the parameters to the end."""

    divisions: int
    n: float
    solution: StudySolution
    seconds: float
    total: float

    @property
    def tangents(self) -> str:
        """Their number, struck out where the solve failed."""
        count = str(self.solution.summary["iterations"]["tangents"])
        return count if self.solution.converged else f"~~{count}~~"


def case(dim: int, divisions: int, n: float) -> Parameters:
    """The block on a regular grid of 1/h = ``divisions``."""
    return block(dim, 1.0 / divisions, mesh__structured=True, penalty__n=n)


def run(dim: int, divisions: int, n: float) -> Run:
    """Solve the case and time it."""
    watch = Stopwatch()
    began = time.process_time()
    solution = solving.solve(case(dim, divisions, n), monitor=watch)
    result = Run(divisions, n, solution, watch.seconds, time.process_time() - began)
    say(
        f"{dim}D, h = 1/{divisions}, n = {n:g}: {result.tangents} tangents, "
        f"{result.seconds:.2f} s of {result.total:.2f} s; {solution.summary['reason']}"
    )
    return result


def warmed_up(dim: int, divisions: int, penalties: Sequence[float]) -> list[Run]:
    """Solve the cases of a mesh, the first of them twice.

    The first solve also gets its memory from the system, which the median of elastic solves
    leaves out, too.
    """
    run(dim, divisions, penalties[0])
    return [run(dim, divisions, n) for n in penalties]


def elastic_seconds(dim: int, divisions: int, repeats: int = 5) -> float:
    """One linear elastic solve: assembly, factorisation (or set-up) and solution; the median."""
    given = assemble(case(dim, divisions, 1.0), MPI.COMM_WORLD)
    system = System(given.data, given.u, given.constraints)
    space, conditions = given.u.function_space, given.constraints.conditions
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    left = compiled.form(forms.elastic_form(u, v, given.data))
    right = compiled.form(forms.external_work(v, given.data))
    rigid, times = system.near_nullspace(), []
    for _ in range(repeats):
        began = time.process_time()
        matrix = petsc.assemble_matrix(left, bcs=conditions)
        matrix.assemble()
        matrix.setOption(PETSc.Mat.Option.SPD, True)
        matrix.setNearNullSpace(rigid)
        load = petsc.assemble_vector(right)
        petsc.set_bc(load, conditions)
        defaults = default_options("auto", dim, system.size, space.mesh.comm)
        ksp = create_ksp(space.mesh.comm, defaults, {"ksp_rtol": 1e-8})
        ksp.setOperators(matrix)
        ksp.solve(load, load.duplicate())
        times.append(time.process_time() - began)
        destroy_ksp(ksp)
        matrix.destroy()
    say(f"{dim}D, h = 1/{divisions}: an elastic solve takes {statistics.median(times):.3f} s")
    return statistics.median(times)


def say(text: str) -> None:
    """Tell how far the measurement is."""
    print(text, file=sys.stderr, flush=True)
