"""Time, history and memory of friction in the checkpoint of a step, beside the state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.parallel import on_root
from contact_locking.results.history import History, read_history
from contact_locking.results.names import HISTORY
from contact_locking.results.solution import StudySolution
from contact_locking.study.assembly import StudyProblem

_PLACE, _SLIP = "old_place", "old_slip"


@dataclass(frozen=True)
class SavedStep:
    """A step that was solved and saved.

    ``memories`` are what friction remembered during the step: for each contact ``u_{k-1,tau}``
    (k, d) and the slip ``s_{k-1}`` (k,).  ``history`` ends with the row of the step, and ``halved``
    tells which steps were halved.
    """

    time: float
    memories: tuple[tuple[FloatArray, FloatArray], ...]
    history: History
    halved: tuple[str, ...]

    def enter(self, contacts: Sequence[NodalContact]) -> None:
        """Give the contacts their memories of the step; collective."""
        for contact, (place, slip) in zip(contacts, self.memories, strict=True):
            contact.recall(place, slip)


def about(solution: StudySolution) -> dict[str, Any] | None:
    """The entry of the record about the step; None for a problem without steps."""
    if not solution.history.rows:
        return None
    return {"time": solution.time, "halved": list(solution.halved)}


def fields(solution: StudySolution) -> dict[str, fem.Function]:
    """The fields with the memories by name; none for a problem without steps; collective."""
    found: dict[str, fem.Function] = {}
    for number, contact in enumerate(solution.contacts if solution.history.rows else ()):
        found[f"{_PLACE}_{number}"] = contact.surface.vector_function(contact.old_place)
        found[f"{_SLIP}_{number}"] = contact.surface.scalar_function(contact.old_slip)
    return found


def write_history(solution: StudySolution, folder: Path) -> None:
    """Write the history of a process beside the record; for rank 0."""
    if solution.history.rows:
        (folder / HISTORY).write_text(solution.history.text(), encoding="utf-8")


def load(
    entry: Mapping[str, Any],
    folder: Path,
    problem: StudyProblem,
    read: Callable[[str, fem.FunctionSpace], fem.Function],
) -> SavedStep:
    """The step of a checkpoint in ``folder``, with the entry of its record; collective.

    Raises InputError for a damaged history.
    """
    dim = problem.domain.dim
    memories = []
    for number, contact in enumerate(problem.contacts):
        surface = contact.surface
        place = read(f"{_PLACE}_{number}", surface.vector_space).x.array
        slip = read(f"{_SLIP}_{number}", surface.scalar_space).x.array
        memories.append((place.reshape(-1, dim)[surface.blocks], slip[surface.nodes]))

    def history() -> History:
        path = folder / HISTORY
        return read_history(path.read_text(encoding="utf-8"), str(path))

    return SavedStep(
        time=float(entry["time"]),
        memories=tuple(memories),
        history=on_root(problem.domain.comm, history),
        halved=tuple(map(str, entry["halved"])),
    )
