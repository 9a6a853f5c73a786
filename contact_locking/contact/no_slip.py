"""Contact without slip: where the body is pressed onto the foundation, it stays where it is."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.friction_bound import FrictionBound
from contact_locking.contact.smoothing import Identity
from contact_locking.contact.surface import ContactSurface
from contact_locking.laws.friction import FrictionLaw
from contact_locking.parallel import maximum

# Where the pressure is below this share of the largest, the body is not pressed.
_PRESSED = 1e-4
# Friction that holds everything is bounded by this multiple of the largest pressure, and friction
# that holds nothing by this share of it, so that each friction cone has an inside.
_ALL, _NONE = 3e2, 1e-9


class NoSlip(FrictionBound):
    """``u_tau = 0`` where ``p > 0``, and ``sigma_tau = 0`` elsewhere: mu = inf without R.

    The friction bound is above every traction where the body is pressed, and does not move with the
    pressure: the points that are pressed are found by one solve after the other.  ``shared`` (k,)
    marks the nodes of another contact, where nothing sticks: the pressure of one foundation and the
    friction of the other would hold each other up to any size.
    """

    stands = True

    def __init__(self, surface: ContactSurface, shared: BoolArray | None = None) -> None:
        def infinite(points: FloatArray, slip: FloatArray) -> FloatArray:
            return np.full(len(slip), math.inf)

        super().__init__(surface, Identity(), FrictionLaw(infinite, math.inf, 0.0))
        self._shared = np.zeros(len(surface.nodes), dtype=bool) if shared is None else shared

    def beside(self, others: Sequence[ContactSurface]) -> NoSlip:
        """The same beside other contacts."""
        nodes = [np.zeros(0, dtype=np.int32), *(other.nodes for other in others)]
        return NoSlip(self.surface, np.isin(self.surface.nodes, np.concatenate(nodes)))

    def on_all(self, level: float) -> FloatArray:
        """A bound (k,) that holds whether the body is pressed or not."""
        return np.where(self._shared, _NONE / _ALL * level, level)

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        largest = maximum(self.surface.domain.comm, pressure)
        is_pressed = (pressure > _PRESSED * largest) & ~self._shared
        return np.where(is_pressed, _ALL * largest, _NONE * largest)
