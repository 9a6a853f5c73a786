"""The parts of Gamma_C that a solver sees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from dolfinx import fem

from contact_locking.surface import ContactSurface
from contact_locking.system import FrictionBound, PenalisedSystem

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ContactPart:
    """One part of Gamma_C: its nodes, contact normal and gap as P1 functions, and its friction."""

    surface: ContactSurface
    normal: fem.Function
    gap: fem.Function
    friction: FrictionBound


def contact_parts(system: PenalisedSystem) -> list[ContactPart]:
    """All parts of Gamma_C, none for a body that touches nothing."""
    bound, contact = system.bound, system.data.contact
    if bound is None or contact is None:
        return []
    return [ContactPart(bound.surface, contact.normal, contact.gap, bound)]


def friction_bounds(system: PenalisedSystem) -> list[FrictionBound]:
    """The friction bounds of all parts with friction."""
    return [part.friction for part in contact_parts(system) if not part.friction.frictionless]


def joint_norm(bounds: Sequence[FrictionBound], values: Sequence[FloatArray]) -> float:
    """The L2 norm over all parts of Gamma_C of values (k,) on each of them; collective."""
    return math.hypot(*(bound.norm(part) for bound, part in zip(bounds, values, strict=True)))
