"""Checks of friction with the values that a problem has on its mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.errors import InputError, with_key
from contact_locking.parallel import agree, on_every_rank

# At this pressure, slight in every unit, a friction bound shows its sign; at 0 it may be 0.
_SLIGHT = 1e-12


def check_friction(contact: NodalContact) -> None:
    """Raise InputError for a mu or a user's own bound that is not from 0 up at each point.

    Both are evaluated without slip, and the bound at a slight pressure.  Collective.
    """
    law, points, comm = contact.friction.law, contact.surface.points, contact.surface.domain.comm
    key, mu = contact.given.friction_key("coefficient"), np.zeros(len(points))
    given = None if (friction := contact.given.friction) is None else friction.coefficient

    def evaluate() -> None:
        # A rank without points has no values whose shape could tell, but for an expression.
        if len(points) or (given is not None and given.expression is not None):
            mu[:] = with_key(key, lambda: law(points, np.zeros(len(points))))

    agree(comm, evaluate)
    is_right = np.isfinite(mu) & (mu >= 0.0)
    if not on_every_rank(comm, is_right):
        wrong = np.concatenate(comm.allgather(mu[~is_right]))
        raise InputError(
            f"mu must be a finite number from 0 up everywhere, and is {wrong[0]:g} somewhere", key
        )
    if not contact.friction.is_coulomb:
        _check_bound(contact, f"{contact.key}.friction")


def _check_bound(contact: NodalContact, key: str) -> None:
    count, comm = len(contact.surface.points), contact.surface.domain.comm
    found: Any = contact.friction.evaluate(np.full(count, _SLIGHT), np.zeros(count))
    wanted = f"evaluate of {type(contact.friction).__name__} must give the friction bound (k,)"

    def require() -> None:
        if np.shape(found) != (count,):
            raise InputError(f"{wanted}, here ({count},), not the shape {np.shape(found)}", key)

    agree(comm, require)
    is_right = np.isfinite(found) & (np.asarray(found) >= 0.0)
    if not on_every_rank(comm, is_right):
        wrong = np.concatenate(comm.allgather(np.asarray(found)[~is_right]))
        raise InputError(
            f"{wanted} of finite numbers from 0 up, and is {wrong[0]:g} somewhere without slip", key
        )
