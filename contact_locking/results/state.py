"""The state of a solution as a value: everything that the next solve may take from it."""

from __future__ import annotations

from dataclasses import dataclass

from contact_locking.contact.state import ContactState
from contact_locking.solver.multipliers import Multipliers
from contact_locking.solver.task import SavedState


@dataclass(frozen=True)
class State:
    """Displacement, multipliers, travel of foundations, and the memory of friction.

    A solver may start from ``saved``; ``contacts`` are the memories of friction at each contact
    after the step that has ended with the solution.
    """

    saved: SavedState
    multipliers: Multipliers
    contacts: tuple[ContactState, ...]
