"""The state of a solution, as a value: all that the next solve may take from it."""

from __future__ import annotations

from dataclasses import dataclass

from contact_locking.contact.state import ContactState
from contact_locking.solver.multipliers import Multipliers
from contact_locking.solver.task import SavedState


@dataclass(frozen=True)
class State:
    """Displacement, multipliers, travel of foundations, and what friction remembers.

    ``saved`` is where a solver may start, and ``contacts`` is what friction remembers of each
    contact after the step that has ended with the solution.
    """

    saved: SavedState
    multipliers: Multipliers
    contacts: tuple[ContactState, ...]
