"""The friction bound of one part of Gamma_C, which follows the pressure of its contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.parallel import maximum
from contact_locking.solver.interior_point.contact_cones import ContactCones
from contact_locking.solver.interior_point.friction_cones import FrictionCones


@dataclass(frozen=True)
class MovingBound:
    """``G = mu(|u_tau|) |R p|`` of ``contact``, from the pressure p of the cones ``pressing``.

    The cones ``friction`` use the bound.  No bound is smaller than the share ``least`` of the
    largest, so that the friction cones have an inside.
    """

    u: fem.Function
    contact: NodalContact
    pressing: ContactCones
    friction: FrictionCones
    least: float

    @property
    def stands(self) -> bool:
        """Whether the bound stays as it is within a solve."""
        return self.contact.friction.stands

    def start(self, moves: bool, least: float) -> None:
        """Give the cones a bound: where it ``moves`` that of the pressure, else what it is now.

        Where it is zero, there is no friction to account for; collective.
        """
        if moves:
            self.contact.bounds = self.wanted()
        self.friction.takes_part = not self.is_zero()
        if self.friction.takes_part:
            bound = self.friction.nodes.of_all(self.contact.bounds)
            self.friction.start_under(bound, self.pressing.z, least)

    def is_zero(self) -> bool:
        """Whether the bound is zero everywhere; collective."""
        return self.contact.norm(self.contact.bounds) == 0.0

    def wanted(self) -> FloatArray:
        """``mu |R p|`` at all nodes of the contact; collective."""
        new = self.contact.friction_bound(self.u, self.pressing.nodes.at_all(self.pressing.z))
        least = self.least * maximum(self.pressing.comm, new)
        return self.contact.acting(np.maximum(new, least))

    def slope(self) -> FloatArray:
        """``mu'(|u_tau|) |R p|`` (k,) at the nodes of the cones; collective.

        It is zero for a bound of the user's own, of which nothing is known but its value.
        """
        bound, nodes = self.contact.friction, self.friction.nodes
        if not (bound.is_coulomb and bound.depends_on_slip):
            return np.zeros(len(nodes.weights))
        smoothed = bound.smoothing.apply(nodes.at_all(self.pressing.z))
        return nodes.of_all(bound.slope(self.contact.slips(self.u)) * np.abs(smoothed))

    def used(self, elsewhere: FloatArray) -> FloatArray:
        """The bound at all nodes of the contact: of the cones, or ``elsewhere`` without cones."""
        used = elsewhere.copy()
        self.friction.nodes.enter(self.friction.bound, used)
        return used

    def set_wanted(self, wanted: FloatArray) -> None:
        """Take the bound that the pressure asks for; collective."""
        self.contact.bounds = wanted
        self.friction.set_bound(self.friction.nodes.of_all(wanted))
