"""The bound of the friction traction at the nodes of a contact: Coulomb's, and that of no slip."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.smoothing import Identity, Smoothing
from contact_locking.contact.surface import ContactSurface
from contact_locking.laws.friction import Coefficient, FrictionLaw
from contact_locking.parallel import maximum

# The central differences of mu take steps of this share of the slip.
_DIFFERENCE = 1e-3
# Where the pressure is below this share of the largest, the body is not pressed.
_PRESSED = 1e-4
# Friction that holds everything is bounded by this multiple of the largest pressure, and friction
# that holds nothing by this share of it, so that each friction cone has an inside.
_ALL, _NONE = 3e2, 1e-9
# With this coefficient what is pressed hardly slips.
_LARGE = 1e5


class FrictionBound:
    """``G(p, s) = mu(x, s) |R p|`` (6): the bound of the friction traction at the nodes.

    ``law`` maps points (k, d) and accumulated slips s (k,) to ``mu`` (k,): a
    :class:`~contact_locking.laws.friction.FrictionLaw`, or a function, for which the
    certificate samples mu* and L_mu.  ``smoothing`` is R.  ``frictionless`` says that mu is zero
    everywhere, and ``stands`` that the bound does not move within a solve.  A user's own friction
    bound is a subclass with another :meth:`evaluate`.
    """

    stands = False

    def __init__(
        self,
        surface: ContactSurface,
        smoothing: Smoothing,
        law: FrictionLaw | Coefficient,
        frictionless: bool = False,
    ) -> None:
        self.surface, self.smoothing, self.frictionless = surface, smoothing, frictionless
        self.law = law if isinstance(law, FrictionLaw) else FrictionLaw(law)

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        """The friction bound (k,) at the owned nodes; collective.

        ``pressure`` (k,) is ``-sigma_nu``, and ``slip`` (k,) is the accumulated slip.
        """
        return self.coefficient(slip) * np.abs(self.smoothing.apply(pressure))

    def coefficient(self, slip: FloatArray) -> FloatArray:
        """``mu(x, s)`` (k,) at the nodes; collective."""
        return self.law(self.surface.points, slip)

    def slope(self, slip: FloatArray) -> FloatArray:
        """``d mu/ds`` (k,) at the nodes, by central differences; collective."""
        largest = maximum(self.surface.domain.comm, slip)
        if largest == 0.0:
            return np.zeros_like(slip)
        width = _DIFFERENCE * slip + _DIFFERENCE**2 * largest
        low, high = np.maximum(slip - width, 0.0), slip + width
        return (self.coefficient(high) - self.coefficient(low)) / (high - low)

    @property
    def depends_on_slip(self) -> bool:
        """Whether mu may depend on the slip: the law alone says that it does not."""
        return self.law.lipschitz != 0.0

    @property
    def is_coulomb(self) -> bool:
        """Whether the friction bound is (6) and not a user's own."""
        return type(self).evaluate is FrictionBound.evaluate


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

    def yielding(self) -> FrictionBound:
        """``_LARGE |p|``, which follows the pressure within a solve."""
        mu = np.where(self._shared, 0.0, _LARGE)
        return FrictionBound(self.surface, Identity(), FrictionLaw(lambda *_: mu, _LARGE, 0.0))

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        largest = maximum(self.surface.domain.comm, pressure)
        is_pressed = (pressure > _PRESSED * largest) & ~self._shared
        return np.where(is_pressed, _ALL * largest, _NONE * largest)
