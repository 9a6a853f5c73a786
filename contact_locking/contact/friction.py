"""Coulomb's friction of one contact: the coefficient mu, and the smoothing R.

A study file is read without DOLFINx, so that what needs a mesh is imported where there is one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import WrapValidator

from contact_locking.arrays import BoolArray, IntArray
from contact_locking.values.concept import Concept, entry
from contact_locking.values.kinds import NonNegative, NonNegativeSlipScalar, Positive

if TYPE_CHECKING:
    from contact_locking.contact.coulomb import FrictionBound
    from contact_locking.contact.smoothing import Smoothing
    from contact_locking.contact.surface import ContactSurface

# The sizes of facets have rounding errors: at a radius of just one facet R does nothing.
_SIZE_ROUNDING = 1e-9


class Kernel(ABC):
    """A smoothing R that is not yet on a mesh."""

    @abstractmethod
    def on(self, surface: ContactSurface, free: BoolArray, sides: IntArray) -> Smoothing:
        """R on a surface; collective.

        Nodes that are not ``free`` (k,) have no pressure, and each of the ``sides`` (n,) of the
        surface is smoothed alone (`ContactSurface.sides`).
        """

    def warnings(self, surface: ContactSurface) -> list[str]:
        """Warnings about data that the user probably did not intend; collective."""
        return []


def _own_kernel(value: Any, handler: Any) -> Any:
    return value if isinstance(value, Kernel) else handler(value)


class Mollifier(Concept, Kernel):
    """R, the mollifier of the normal stress along Gamma_C."""

    kernel: Literal["convolution", "helmholtz", "none"] | None = entry(
        None,
        "convolution, helmholtz (I - r^2 Laplace_Gamma), or none: local Coulomb; null: convolution",
    )
    radius: Positive | None = entry(
        None,
        "r, of the kernel, measured along Gamma_C; null: a tenth of the extent of Gamma_C, two "
        "facets at least",
        "length",
    )

    def over(self, common: Mollifier) -> Mollifier:
        """``common``, with what this one says itself."""
        return common.model_copy(update=self.stated())

    def on(self, surface: ContactSurface, free: BoolArray, sides: IntArray) -> Smoothing:
        from contact_locking.contact.coulomb import operator_of

        return operator_of(self.kernel, self.radius, surface, free, sides)

    def warnings(self, surface: ContactSurface) -> list[str]:
        size = surface.domain.facet_diameter(surface.facets)
        is_wide = self.radius is None or self.radius > size * (1.0 + _SIZE_ROUNDING)
        if is_wide or self.kernel == "none":
            return []
        return [
            f"radius: {self.radius:g} is not larger than the mesh size {size:.3g} on "
            f"{', '.join(surface.names)}, so R hardly smooths; refine the mesh there or enlarge "
            "the radius"
        ]


def Convolution(radius: float | None = None) -> Mollifier:
    """``R w(x) = int k(|x - y|/r) w(y) / int k(|x - y|/r)``, k a smooth bump with the radius r.

    ``radius`` is r, a length; without one it is a tenth of the extent of the contact, and twice its
    longest facet at least.
    """
    return Mollifier("convolution", radius)


def Helmholtz(radius: float | None = None) -> Mollifier:
    """``(I - r^2 Laplace_Gamma) R w = w`` with natural conditions at the edge of the contact."""
    return Mollifier("helmholtz", radius)


def Local() -> Mollifier:
    """``R w = w``: local Coulomb friction."""
    return Mollifier("none")


class Coulomb(Concept):
    """``|sigma_tau| <= mu(x, s) |R sigma_nu|`` (6), with s the accumulated slip.

    ``coefficient`` is mu: a finite number, an expression, a constant of DOLFINx, a function of
    points (k, d) and slips (k,), or a :class:`~contact_locking.laws.friction.FrictionLaw`.  What is
    None is as in the section ``friction`` of a study file.  A user's own friction bound is a
    subclass whose :meth:`on` returns another :class:`FrictionBound`.
    """

    coefficient: NonNegativeSlipScalar | None = entry(
        None,
        "mu >= 0, a number or an expression of x, y, z and s = |u_tau|; null: 0",
        "1",
    )
    smoothing: Annotated[Mollifier, WrapValidator(_own_kernel)] | None = entry(
        None, "the mollifier R"
    )
    regularisation: NonNegative | None = entry(
        None,
        "the slip at which friction reaches 71 % of its bound, eps of (22); 0: Coulomb's law "
        "itself, without regularisation; null: penalty.epsilon times Young's modulus",
        "length",
    )

    def over(self, common: Coulomb) -> Coulomb:
        """``common``, with what this one says itself."""
        own = self.stated()
        if isinstance(self.smoothing, Mollifier):
            own["smoothing"] = self.smoothing.over(common.smoothing or Mollifier())
        return common.model_copy(update=own)

    @property
    def kernel(self) -> Kernel:
        """R."""
        return Mollifier() if self.smoothing is None else self.smoothing

    @property
    def is_zero(self) -> bool:
        """Whether there is no friction."""
        return self.coefficient is None or self.coefficient.number == 0.0

    def on(self, surface: ContactSurface, smoothing: Smoothing) -> FrictionBound:
        """The friction bound on a surface, with R there."""
        from contact_locking.contact.coulomb import FrictionBound
        from contact_locking.contact.smoothing import Identity

        # Without friction nothing asks for R, whose matrix would be made for its field.
        kernel = Identity() if self.is_zero else smoothing
        return FrictionBound(surface, kernel, self.coefficient, self.is_zero)
