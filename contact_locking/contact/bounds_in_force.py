"""The friction of all contacts at present, which solvers change and forms use."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact


class BoundsInForce:
    """The friction bound G in force at each contact, a stress; all are zero at first.

    ``bounds[contact]`` are the values (k,) at the owned nodes of the contact.  To set them is
    collective.  ``lengths[contact]`` is the length that smooths friction at present.
    """

    def __init__(self, contacts: Sequence[NodalContact]) -> None:
        self._functions = {
            contact: contact.surface.scalar_function(
                np.zeros(len(contact.surface.nodes)), "friction_bound"
            )
            for contact in contacts
        }
        self.lengths = {
            contact: fem.Constant(contact.surface.domain.mesh, contact.regularisation)
            for contact in contacts
        }

    def function(self, contact: NodalContact) -> fem.Function:
        """G on a contact, for forms."""
        return self._functions[contact]

    def __getitem__(self, contact: NodalContact) -> FloatArray:
        return np.asarray(self._functions[contact].x.array[contact.surface.nodes])

    def __setitem__(self, contact: NodalContact, values: FloatArray) -> None:
        function = self._functions[contact].x
        function.array[contact.surface.nodes] = values
        function.scatter_forward()

    def at(self, contacts: Iterable[NodalContact]) -> list[FloatArray]:
        """The values at some contacts."""
        return [self[contact] for contact in contacts]

    def enter(self, contacts: Iterable[NodalContact], values: Iterable[FloatArray]) -> None:
        """Set the values at some contacts; collective."""
        for contact, part in zip(contacts, values, strict=True):
            self[contact] = part
