"""The bound of the friction traction at the nodes of a contact."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.smoothing import Smoothing
from contact_locking.contact.surface import ContactSurface
from contact_locking.laws.friction import Coefficient, FrictionLaw
from contact_locking.parallel import maximum

# The central differences of mu take steps of this share of the slip.
_DIFFERENCE = 1e-3


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
