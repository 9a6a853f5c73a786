"""A problem of two bodies with the sides of contact swapped: its forces are the opposite ones.

Pressure is at the nodes of `on` and gaps are measured to the facets of `against`, so that both
problems differ by the error of the mesh.  The allowance for it is 5 %, or, where this is not
enough, twice what halved cells change in the forces of both: an error that is halved with the cells
is twice its change.  Where this is more than the largest force, it would allow anything, and the
halved cells are compared in place of the given ones.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import FloatArray
from contact_locking.errors import ContactLockingError
from contact_locking.mesh.domain import Domain
from contact_locking.results.solution import StudySolution
from contact_locking.running.solving import solve_assembled
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

from .case import Study

ALLOWED = 0.05
# Cells are halved so often, until the error of the mesh is less than the largest force.
LEVELS = 2
# The kinds of results.
AGREES, BY_MESH, DIFFERS = "within 5 %", "within the error of the mesh", "beyond it"
NONE = "nothing to compare with"
KINDS = (AGREES, BY_MESH, DIFFERS, NONE)


_Pair = tuple[FloatArray, FloatArray]


@dataclass(frozen=True)
class Compared:
    """The largest difference of a force, relative to the largest force, and the allowance.

    ``error`` is that of the mesh, 0 where 5 % are enough; ``unknown`` says why there is nothing to
    compare with.
    """

    difference: float = 0.0
    error: float = 0.0
    unknown: str = ""

    @property
    def complaint(self) -> str:
        """How the forces differ; "" if they agree."""
        if self.unknown or self.difference <= max(ALLOWED, self.error):
            return ""
        return (
            f"another solution with the sides swapped: forces differ by {self.difference:.3f}, "
            f"the error of the mesh is {self.error:.3f}"
        )

    @property
    def note(self) -> str:
        """The kind of the result."""
        if self.unknown:
            return f"{NONE}: {self.unknown}"
        return DIFFERS if self.complaint else BY_MESH if self.error else AGREES


def exchanged(study: Study) -> Study | None:
    """The study with `on` and `against` of each contact swapped; None without two sides."""
    contact = study["contact"]
    sections = contact if isinstance(contact, list) else [contact]
    # Grains touch each other under one name, which leaves nothing to swap.
    if any(item.get("against") in (None, item["on"]) for item in sections):
        return None
    study = copy.deepcopy(study)
    swapped = [item | {"on": item["against"], "against": item["on"]} for item in sections]
    study["contact"] = swapped if isinstance(contact, list) else swapped[0]
    return study


def compared(study: Study, solution: StudySolution, rounding: float) -> Compared | None:
    """A solution beside that of the swapped problem; None where there is no such problem.

    ``rounding`` is the size of forces that say nothing.
    """
    other = exchanged(study)
    if other is None:
        return None
    pair = (study, other)
    try:
        coarse = (forces(solution), -forces(_solved(other, solution.domain), -1.0))
        found = _between(coarse, None, rounding)
        for _ in range(LEVELS if found.difference > ALLOWED else 0):
            pair = (_halved(pair[0]), _halved(pair[1]))
            fine = (forces(_solved(pair[0])), -forces(_solved(pair[1]), -1.0))
            found = _between(coarse, fine, rounding)
            if found.error < 1.0:
                break
            coarse = fine
    except ContactLockingError as error:
        return Compared(unknown=" ".join(str(error).split()))
    unknown = _coarse(pair[0]) if found.complaint else ""
    if found.error >= 1.0:
        unknown = f"the error of the mesh is {found.error:.1f} of the largest force"
    return Compared(unknown=unknown) if unknown else found


def _between(coarse: _Pair, fine: _Pair | None, rounding: float) -> Compared:
    """The difference on a mesh, with its error by what halved cells change."""
    scale = max(*map(_largest, coarse), rounding)
    difference = _largest(coarse[0] - coarse[1]) / scale
    if fine is None:
        return Compared(difference)
    changes = sum(_largest(new - old) for new, old in zip(fine, coarse, strict=True))
    return Compared(difference, 2.0 * changes / scale)


def forces(solution: StudySolution, sign: float = 1.0) -> FloatArray:
    """(k, d) contact force of each contact, friction force, and ``sign`` times each reaction."""
    told = solution.summary
    rows = [np.array(item["contact_force"]) for item in told["contacts"]]
    friction = sum(np.array(item["friction_force"]) for item in told["contacts"])
    reactions = [sign * np.array(force) for _, force in sorted(told["reactions"].items())]
    return np.array([*rows, friction, *reactions])


def _coarse(study: Study) -> str:
    """Why these cells tell nothing about the error of the mesh; "" if they do.

    The chord of a cell of size h lies ``h^2 / 8`` within a disc of radius 1.  Where the fingers of
    a grip come closer by less, their nodes do not meet the chords, but the disc's nodes meet them.
    """
    mesh, held = study["mesh"], study["loads"].get("displacements", [])
    if mesh["builder"] != "grip":
        return ""
    depth = max(abs(item["value"][0]) for item in held)
    left_out = mesh["h"] ** 2 / 8.0
    if left_out <= depth:
        return ""
    return f"chords leave out {left_out:.1e} of the disc, and the fingers come by {depth:.1e}"


def _largest(rows: FloatArray) -> float:
    return float(np.linalg.norm(rows, axis=1).max())


def _halved(study: Study) -> Study:
    return study | {"mesh": study["mesh"] | {"h": 0.5 * study["mesh"]["h"]}}


def _solved(study: Study, domain: Domain | None = None) -> StudySolution:
    problem = assemble(Parameters.model_validate(study), MPI.COMM_SELF, domain)
    solution = solve_assembled(problem)
    if not solution.converged:
        raise ContactLockingError(f"not solved: {solution.summary['reason']}")
    return solution
