"""Bend a thin plate of some 100 000 unknowns onto a floor, and print a row of what it took.

    ./in-env python3 benchmarks/plates.py 200 82 1
    ./in-env python3 benchmarks/plates.py 30 30 4 --degree 2 --linear iterative

The plate of 200 by 200 (or by as much as makes its cells square) by 1 is a grid of so many cells,
clamped on one side, under its own weight and without friction, n = inf.  Times are CPU seconds of
the solve with its certificate; "compact" are the unknowns of a cube that takes as long to
factorise.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

import contact_locking as cl
from contact_locking.mesh.parts import NamedFacets
from contact_locking.solver.ksp import is_direct

LENGTH, GAP = 200.0, 0.2


def problem(cells: list[int], degree: int, linear: str, load: float) -> cl.ContactProblem:
    """The plate above its floor."""
    width = LENGTH if cells[0] == cells[1] else LENGTH * cells[1] / cells[0]
    body = dmesh.create_box(MPI.COMM_WORLD, [[0.0, 0.0, 0.0], [LENGTH, width, 1.0]], cells)
    space = fem.functionspace(body, ("Lagrange", degree, (3,)))
    left, bottom = (
        dmesh.locate_entities_boundary(body, 2, lambda x, axis=axis: np.isclose(x[axis], 0.0))
        for axis in (0, 2)
    )
    held = fem.dirichletbc(np.zeros(3), fem.locate_dofs_topological(space, 2, left), space)
    # A beam sinks by so many gaps, and linear elements by far less.
    weight = ufl.as_vector((0.0, 0.0, -load * GAP / (1.5 * LENGTH**4)))
    return cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.3),
        ufl.inner(weight, ufl.TestFunction(space)) * ufl.dx,
        [held],
        [],
        [cl.Contact(bottom, gap=GAP)],
        space=space,
        settings=cl.Settings(linear=linear),
    )


def main() -> None:
    """Solve, and print a row in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cells", type=int, nargs=3, help="along x, y and z")
    parser.add_argument("--degree", type=int, default=1)
    parser.add_argument("--linear", default="auto")
    given = parser.parse_args()
    plate = problem(given.cells, given.degree, given.linear, 300.0 if given.degree == 1 else 10.0)
    began = time.process_time()
    solution = plate.solve()
    seconds = time.process_time() - began
    assert solution.converged, solution.summary["reason"]
    mesh, counts = solution.displacement.function_space.mesh, solution.summary["iterations"]
    unknowns = solution.summary["dofs"]
    compact = NamedFacets(mesh).domain().compact_size(unknowns, given.degree)
    linear = "direct" if is_direct(given.linear, 3, compact) else "iterative"
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    shape = " x ".join(map(str, given.cells))
    print(
        f"| {shape} | {given.degree} | {unknowns} | {compact} | {linear} | {counts['tangents']} | "
        f"{counts['linear']} | {seconds:.1f} | {memory:.2f} GB |"
    )


if __name__ == "__main__":
    main()
