"""Random bodies on a block, by the package and by nodes against segments, side by side.

A problem is solved with either side as `on`.  Its response is the contact force where the body is
moved, and the work of the loads where it is pressed.  It is right if

  response  with either side is within 5 % of the judge's, or within the error of the mesh,
  peak      no nodal pressure is above 2.5 times the largest one of the judge,
  friction  the share of the bound that acts is within 0.1 and the error of the mesh of the judge's
  swapped   both sides have the same response within 5 %, or within twice the error of the mesh.

The judge is the mean of its own two roles, for linear elements on the same mesh and for quadratic
ones on the mesh whose triangles are cut into 16.  The error of the mesh is half the difference of
its roles, as the package may be at either, and its change when triangles are cut into four.  The
judge's largest pressure is that of both roles on both meshes, and so has the pressure at the edge
of each body.  At a square edge it grows by less than 1.5 if facets are halved: 2.5 leaves room for
a facet of a sixth of the size, and finds forces that are divided by the area of a sliver.

That error of the mesh is the judge's, which has linear elements and the chords of the given mesh.
The package may have a larger one: with quadratic facets whose control values touch before their
nodes do, and beside curves.  Where it is off, or its criterion `bodies_apart` says that an edge
enters between nodes, the facets are halved, at most twice, and the finer mesh decides.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI
from msh import write_msh

from contact_locking.errors import ContactLockingError
from contact_locking.running.assembly import assemble
from contact_locking.running.solving import solve_assembled
from contact_locking.study_file.parameters import Parameters

from .elements import Mesh
from .node_to_segment import TwoBodies, refined
from .punches import Punch, punch

LIMIT, OUTLIER, USED = 0.05, 2.5, 0.1
# Facets are halved so often.
HALVED = 2
#: The name of the family, which the sweep solves on demand.
PUNCHES = "punches"


class Apart(ContactLockingError):
    """No criterion fails but the one for bodies that are apart, or in one another."""


@dataclass(frozen=True)
class Answer:
    """The response, the largest pressure, and the share of friction that acts."""

    response: float
    peak: float
    used: float


@dataclass(frozen=True)
class Judged:
    """The answer of the judge, and the error of the mesh in the response and the friction."""

    answer: Answer
    error: float
    used_error: float


@dataclass
class Compared:
    """A problem with the answers of the package, for either side as `on`, and what fails.

    ``coarser`` are the words for the meshes before facets were halved.
    """

    seed: int
    words: str
    judged: Judged
    answers: list[Answer] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    by_mesh: bool = False
    reason: str = ""
    seconds: float = 0.0
    coarser: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        right, answers = self.judged.answer, self.answers
        off = " ".join(f"{100.0 * (one.response / right.response - 1.0):+.1f}" for one in answers)
        peaks = " ".join(f"{one.peak / right.peak:.2f}" for one in answers)
        used = " ".join(f"{one.used:.2f}" for one in (right, *answers))
        return (
            f"{self.seed}: {f'WRONG ({chr(44).join(self.failed)})' if self.failed else 'right'}: "
            f"off {off} %, mesh {100.0 * self.judged.error:.1f} %, peaks {peaks}, "
            f"{f'used {used}, ' if right.used else ''}{self.seconds:.1f} s: {self.words}"
            f"{self.reason and f': {self.reason}'}"
            f"{''.join(f'{chr(10)}  coarser: {one}' for one in self.coarser)}"
        )


def judged(problem: Punch) -> Judged:
    """By nodes against segments, with the nodes of either side."""
    mesh, is_quadratic = problem.mesh, problem.study["discretisation"]["degree"] == 2
    mesh = refined(mesh) if is_quadratic else mesh
    levels = [_by_segments(problem, level) for level in (mesh, refined(mesh))]
    peak = max(one.peak for level in levels for one in level)
    values = np.array([[(one.response, one.used) for one in level] for level in levels])
    means = values.mean(axis=1)
    best = means[1] if is_quadratic else means[0]
    errors = 0.5 * np.abs(values[0, 1] - values[0, 0]) + np.abs(means[1] - means[0])
    return Judged(Answer(best[0], peak, best[1]), errors[0] / best[0], errors[1])


def _by_segments(problem: Punch, mesh: Mesh) -> list[Answer]:
    bodies = TwoBodies(mesh, problem.study, problem.sides)
    friction, answers = problem.study["friction"]["coefficient"], []
    for side in problem.sides:
        found = bodies.solve(side, friction)
        work = float(np.sum(bodies.load.reshape(-1, 2) * found.u))
        bound = friction * float(found.normal.sum())
        used = float(np.abs(found.along).sum()) / bound if bound > 0.0 else 0.0
        response = work if problem.is_pressed else abs(float(found.force[1]))
        answers.append(Answer(response, float(found.pressure.max(initial=0.0)), used))
    return answers


def compared(seed: int) -> Compared:
    """Solve and judge a problem, and with halved facets where it is off."""
    outcome = on_mesh(seed)
    for number in range(HALVED):
        if not outcome.failed or "solved" in outcome.failed:
            break
        finer = on_mesh(seed, 2 ** (number + 1))
        finer.coarser = [*outcome.coarser, str(outcome).split("\n")[0]]
        outcome = finer
    return outcome


def on_mesh(seed: int, fineness: int = 1) -> Compared:
    """Solve and judge a problem on one mesh; errors of the package are failures."""
    start = time.process_time()
    problem = punch(seed, fineness)
    outcome = Compared(seed, problem.words, judged(problem))
    try:
        outcome.answers = [solved(problem, side) for side in problem.sides]
        outcome.failed, outcome.by_mesh = verdict(outcome.judged, outcome.answers)
    except ContactLockingError as error:
        outcome.failed = ["apart" if isinstance(error, Apart) else "solved"]
        outcome.reason = " ".join(str(error).split())[:150]
    outcome.seconds = time.process_time() - start
    return outcome


def verdict(judge: Judged, answers: Sequence[Answer]) -> tuple[list[str], bool]:
    """What fails, and whether nothing does but by the error of the mesh."""
    right = judge.answer
    off = [one.response / right.response - 1.0 for one in answers]
    away, swapped = max(map(abs, off)), abs(off[1] - off[0])
    bad = {
        "response": away > max(LIMIT, judge.error),
        "peak": max(one.peak for one in answers) > OUTLIER * right.peak,
        "friction": max(abs(one.used - right.used) for one in answers) > USED + judge.used_error,
        "swapped": swapped > max(LIMIT, 2.0 * judge.error),
    }
    failed = [name for name, is_bad in bad.items() if is_bad]
    return failed, not failed and max(away, swapped) > LIMIT


def solved(problem: Punch, on: str) -> Answer:
    """The package's answer with that side as `on`."""
    against = problem.sides[on == problem.sides[0]]
    with tempfile.TemporaryDirectory() as folder:
        path = write(problem.mesh, Path(folder) / "punch.msh")
        study = problem.study | {
            "mesh": problem.study["mesh"] | {"file": str(path)},
            "contact": {"on": on, "against": against},
        }
        parameters = Parameters.model_validate(study)
        solution = solve_assembled(assemble(parameters, MPI.COMM_SELF))
    told = solution.summary
    if not solution.converged:
        criteria = told["certificate"]["criteria"]
        fails = [name for name, one in criteria.items() if not one["holds"]]
        raise (Apart if fails == ["bodies_apart"] else ContactLockingError)(str(told["reason"]))
    force = told["contact_force"][1] + told["friction_force"][1]
    response = told["compliance"] if problem.is_pressed else abs(force)
    return Answer(response, float(told["pressure_max"]), float(told["friction_used"] or 0.0))


def write(mesh: Mesh, path: Path) -> Path:
    parts = {name: mesh.cells[chosen] for name, chosen in mesh.regions.items()} | mesh.parts
    points: Any = mesh.x.tolist()
    groups: dict[str, Any] = {name: (nodes + 1).tolist() for name, nodes in parts.items()}
    return write_msh(path, points, groups)
