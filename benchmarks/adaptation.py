"""The error on adapted and uniform meshes over unknowns and time: docs/guides/adaptive.md.

    ./in-env python3 benchmarks/adaptation.py    some minutes

The case is the block of the other benchmarks with n = inf, mu = 0.3 and R over r = 0.1.  The
reference is the solution with quadratic displacements on the finest of a further sequence of
adapted meshes.  The error is the norm of the difference of the strains, by Gauss's rule of degree 2
on the cells of the reference, relative to the strain of the reference.  Times are CPU seconds of
this process on one rank; the time of an adapted mesh includes all meshes before.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import basix
import numpy as np
from dolfinx import fem, geometry

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.fem import compiled
from contact_locking.laws.body import strain
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.running.solving import solve_adaptively
from contact_locking.study_file.parameters import Parameters

sys.path.append(str(Path(__file__).resolve().parent.parent / "tests/support"))
sys.path.append(str(Path(__file__).resolve().parent.parent / "demos/studies"))
from convergence import fitted_rate
from problems import block
from rates import Curve, Panel, rate_plot


def case(divisions: int, degree: int, **adapt: Any) -> Parameters:
    """The block on a regular grid of 1/h = ``divisions``, for a keyword as the first mesh."""
    return block(
        2,
        1.0 / divisions,
        mesh__structured=True,
        friction__smoothing={"kernel": "convolution", "radius": 0.1},
        penalty__n=math.inf,
        discretisation={"degree": degree},
        adapt=adapt or None,
    )


@dataclass(frozen=True)
class Strain:
    """The strain of a solution as a function of the place."""

    function: fem.Function
    tree: Any

    @classmethod
    def of(cls, solution: StudySolution) -> Strain:
        mesh = solution.domain.mesh
        space = fem.functionspace(mesh, ("DG", solution.element.degree - 1, (2, 2)))
        function = fem.Function(space)
        expression = compiled.interpolation(strain(solution.displacement), space)
        function.interpolate(expression)
        return cls(function, geometry.bb_tree(mesh, 2))

    def at(self, points: FloatArray) -> FloatArray:
        """The values (k, 4) at points (k, 3)."""
        mesh = self.function.function_space.mesh
        candidates = geometry.compute_collisions_points(self.tree, points)
        found = geometry.compute_colliding_cells(mesh, candidates, points)
        cells = found.array[found.offsets[:-1]]
        return np.asarray(self.function.eval(points, cells))


class Reference:
    """The strain of the reference at the points of a quadrature."""

    def __init__(self, solution: StudySolution) -> None:
        mesh = solution.domain.mesh
        points, weights = basix.make_quadrature(basix.CellType.triangle, 2)
        corners = mesh.geometry.x[_compat.cell_nodes(mesh)][:, :, :2]
        shares = np.column_stack([1.0 - points.sum(axis=1), points])
        places = np.einsum("qc,kcd->kqd", shares, corners)
        edges = corners[:, 1:] - corners[:, :1]
        self.weights = np.outer(np.abs(np.linalg.det(edges)), weights).ravel()
        self.points = np.zeros((len(self.weights), 3))
        self.points[:, :2] = places.reshape(-1, 2)
        self.strain = Strain.of(solution).at(self.points)

    def error(self, solution: StudySolution) -> float:
        """The relative error in V."""
        difference = Strain.of(solution).at(self.points) - self.strain
        return float(np.sqrt(self._square(difference) / self._square(self.strain)))

    def _square(self, values: FloatArray) -> float:
        return float(self.weights @ np.sum(values**2, axis=1))


@dataclass(frozen=True)
class Row:
    """A mesh: unknowns, seconds, tangents, and the estimated and the measured relative error."""

    dofs: int
    seconds: float
    tangents: int
    estimate: float
    error: float


def uniform(reference: Reference, degree: int, grids: list[int]) -> Iterator[Row]:
    """Regular grids."""
    solving.solve(case(4, degree))  # compiles the forms
    for divisions in grids:
        began = time.process_time()
        solution = solving.solve(case(divisions, degree))
        yield row(reference, solution, time.process_time() - began)


def adapted(reference: Reference, degree: int, most: int) -> Iterator[Row]:
    """Adapted meshes with at most so many unknowns."""
    given = case(8, degree, tolerance=1e-4, max_dofs=most, max_meshes=20)
    began, spent = time.process_time(), 0.0
    for solution in solve_adaptively(given):
        spent += time.process_time() - began
        yield row(reference, solution, spent)
        began = time.process_time()


def row(reference: Reference, solution: StudySolution, seconds: float) -> Row:
    """The row of a solution."""
    assert solution.converged, solution.summary["reason"]
    summary = solution.summary
    found = Row(
        summary["dofs"],
        seconds,
        summary["iterations"]["tangents"],
        summary["certificate"]["errors"]["mesh"]["relative"],
        reference.error(solution),
    )
    print(found, flush=True)
    return found


def main() -> None:
    """Print the tables, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--most", type=int, default=60_000, help="unknowns of the reference")
    parser.add_argument("--figure", type=Path, help="write the plot here")
    arguments = parser.parse_args()
    given = case(8, 2, tolerance=1e-4, max_dofs=arguments.most, max_meshes=30)
    *_, finest = solve_adaptively(given)
    print("reference", finest.summary["dofs"], finest.summary["adapt"]["meshes"][-1], flush=True)
    reference = Reference(finest)
    fifth = arguments.most // 5
    tables = {
        "P1, uniform": list(uniform(reference, 1, [32, 64, 128, 256, 350])),
        "P1, adapted": list(adapted(reference, 1, fifth)),
        "P2, uniform": list(uniform(reference, 2, [8, 16, 32, 64])),
        "P2, adapted": list(adapted(reference, 2, fifth)),
    }
    for name, rows in tables.items():
        rate = -2.0 * fitted_rate([r.dofs for r in rows[-4:]], [r.error for r in rows[-4:]])
        print(f"\n{name}, rate {rate:.2f} in h")
        for r in rows:
            print(
                f"| {r.dofs} | {r.error:.4f} | {r.estimate:.4f} | {r.tangents} | {r.seconds:.1f} |"
            )
    if arguments.figure:
        panels = [
            Panel(
                f"Error over {x}",
                x,
                "relative error in V",
                [
                    Curve(name, [getattr(r, key) for r in rows], [r.error for r in rows])
                    for name, rows in tables.items()
                ],
            )
            for x, key in (("unknowns", "dofs"), ("CPU seconds", "seconds"))
        ]
        rate_plot(panels, arguments.figure)


if __name__ == "__main__":
    main()
