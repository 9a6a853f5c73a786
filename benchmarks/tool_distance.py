"""The time of a tool of 100 000 triangles beside the solve, for docs/benchmarks.md.

    ./in-env python3 benchmarks/tool_distance.py    a minute

A ball of triangles is pressed into a block.  Times are CPU seconds of this process on one rank: of
the tool once, to read and check its file and to build the search of VTK, and in each step, for gap
and normal at the nodes of Gamma_C at a new place.  The solve is that of one step; nothing is timed
before its forms are compiled.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking.running.assembly import assemble
from contact_locking.running.solving import SolvableStudy
from contact_locking.shapes.faceted import TriangulatedSurface
from contact_locking.shapes.tool_files import read_surface
from contact_locking.study_file.parameters import Parameters

# The block and the files of tools belong to the tests.
sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
from problems import block
from tool_files import ball, binary_stl

# The ball has the square of this number of triangles.
_SIDES = 318
_SIZES = (0.2, 0.1, 0.0667)


def case(h: float, file: Path, n: float) -> Parameters:
    """A block whose top is pressed by the ball, which moves."""
    contact: dict[str, Any] = {
        "on": "top",
        "foundation": {"surface": str(file), "motion": [0, 0, "-0.05*t"]},
    }
    held = {"displacements": [{"on": "bottom", "value": [0.0, 0.0, 0.0]}]}
    return block(
        3,
        h,
        loads=held,
        contact=contact,
        steps={"times": [0.5, 1.0]},
        material__locking_limit=0.1,
        penalty__n=n,
    )


def measured(h: float, file: Path, n: float) -> tuple[int, int, float, float]:
    """Cells, nodes of Gamma_C, seconds of the tool in a step, and of the solve."""
    problem = assemble(case(h, file, n), MPI.COMM_SELF)
    solver = SolvableStudy(problem).solver
    problem.advance(0.5)
    solver.begin()
    solver.solve()
    (contact,) = problem.contacts
    problem.clock.set(1.0)
    began = time.process_time()
    contact.update_foundation()
    placed = time.process_time()
    problem.advance(1.0)
    solver.begin()
    solving = time.process_time()
    assert solver.solve().converged
    ended = time.process_time()
    nodes = len(problem.contacts[0].surface.nodes)
    problem.close()
    return problem.domain.num_cells, nodes, placed - began, ended - solving


def main() -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "ball.stl")
        triangles = ball(1.0, np.array([0.5, 0.5, 2.0]), _SIDES)
        file.write_bytes(binary_stl(triangles))
        began = time.process_time()
        points, numbers, _ = read_surface(file)
        read = time.process_time()
        TriangulatedSurface(points, numbers).gap(np.full((3, 1), 0.5))
        built = time.process_time()
        print(
            f"{len(numbers)} triangles: read and checked in {read - began:.2f} s, "
            f"search built in {built - read:.2f} s\n"
        )
        print("| cells | nodes of Γ_C | n | tool, a step | solve | share |")
        print("| --- | --- | --- | --- | --- | --- |")
        for n in (1e3, math.inf):
            for h in _SIZES:
                cells, nodes, tool, solve = measured(h, file, n)
                print(
                    f"| {cells} | {nodes} | {n:g} | {tool:.3f} s | {solve:.2f} s | "
                    f"{100.0 * tool / solve:.1f} % |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
