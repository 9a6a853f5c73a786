"""Coulomb's friction of one contact: the bound of its traction, and the smoothing R."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from numbers import Real

import numpy as np
from dolfinx import fem

from contact_locking.arrays import BoolArray, FloatArray, IntArray, present
from contact_locking.contact.smoothing import (
    ConvolutionOperator,
    HelmholtzOperator,
    Identity,
    Smoothing,
)
from contact_locking.contact.surface import ContactSurface
from contact_locking.contact.surface_mesh import SurfaceMesh
from contact_locking.laws.friction import Coefficient, FrictionLaw
from contact_locking.parallel import maximum

# The default radius of R is this share of the extent of Gamma_C.  It is at least twice the longest
# facet: the kernel vanishes at the radius, and R has to reach the neighbours of each node.
_DEFAULT_RADIUS_SHARE, _DEFAULT_RADIUS_FACETS = 0.1, 2.0
# A filter with a larger radius than this share of the extent is the mean over Gamma_C to nine
# digits.
_LARGEST_RADIUS_SHARE = 1e4
# The sizes of facets have rounding errors: at a radius of just one facet R does nothing.
_SIZE_ROUNDING = 1e-9
# The central differences of mu take steps of this share of the slip.
_DIFFERENCE = 1e-3


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


@dataclass(frozen=True)
class Local(Kernel):
    """``R w = w``: local Coulomb friction."""

    def on(self, surface: ContactSurface, free: BoolArray, sides: IntArray) -> Smoothing:
        return Identity()


@dataclass(frozen=True)
class Convolution(Kernel):
    """``R w(x) = int k(|x - y|/r) w(y) / int k(|x - y|/r)``, k a smooth bump with the radius r.

    ``radius`` is r, a length; without one it is a tenth of the extent of the contact, and twice its
    longest facet at least.  ``key`` names the radius in messages.
    """

    radius: float | None = None
    key: str = "smoothing.radius"

    def on(self, surface: ContactSurface, free: BoolArray, sides: IntArray) -> Smoothing:
        whole = surface.whole(free, sides)
        radius = default_radius(surface) if self.radius is None else self.radius
        return self._inside(surface, whole, sides, radius)

    def _inside(
        self, surface: ContactSurface, whole: SurfaceMesh, sides: IntArray, radius: float
    ) -> Smoothing:
        return ConvolutionOperator(surface.domain.comm, whole, radius)

    def warnings(self, surface: ContactSurface) -> list[str]:
        size = surface.domain.facet_diameter(surface.facets)
        if self.radius is None or self.radius > size * (1.0 + _SIZE_ROUNDING):
            return []
        return [
            f"{self.key}: {self.radius:g} is not larger than the mesh size {size:.3g} on "
            f"{', '.join(surface.names)}, so R hardly smooths; refine the mesh there or enlarge "
            "the radius"
        ]


@dataclass(frozen=True)
class Helmholtz(Convolution):
    """``(I - r^2 Laplace_Gamma) R w = w`` with natural conditions at the edge of the contact."""

    def _inside(
        self, surface: ContactSurface, whole: SurfaceMesh, sides: IntArray, radius: float
    ) -> Smoothing:
        radius = min(radius, _LARGEST_RADIUS_SHARE * _extent(surface))
        return HelmholtzOperator(surface.domain.comm, whole, surface.laplacian(sides), radius)


class FrictionBound:
    """``G(p, s) = mu(x, s) |R p|`` (6): the bound of the friction traction at the nodes.

    ``law`` maps points (k, d) and accumulated slips s (k,) to ``mu`` (k,): a
    :class:`~contact_locking.laws.friction.FrictionLaw`, or a function, for which the
    certificate samples mu* and L_mu.  ``smoothing`` is R.  ``frictionless`` says that mu is zero
    everywhere.  A user's own friction bound is a subclass with another :meth:`evaluate`.
    """

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


@dataclass(frozen=True)
class Coulomb:
    """``|sigma_tau| <= mu(x, s) |R sigma_nu|`` (6), with s the accumulated slip.

    ``coefficient`` is mu: a finite number, a constant of DOLFINx, a function of points (k, d) and
    slips (k,), or a :class:`~contact_locking.laws.friction.FrictionLaw`.  ``regularisation`` is the
    slip, a length, at which friction reaches 71 % of its bound (22); 0 is Coulomb's law itself, and
    None stands for the compliance of the contact times Young's modulus.  A user's own friction
    bound is a subclass whose :meth:`on` returns another :class:`FrictionBound`.
    """

    coefficient: float | fem.Constant | Coefficient | FrictionLaw = 0.0
    smoothing: Kernel = field(default_factory=Convolution)
    regularisation: float | None = None

    @property
    def law(self) -> FrictionLaw:
        """Mu with its constants."""
        match self.coefficient:
            case FrictionLaw():
                return self.coefficient
            case Real():
                mu = float(self.coefficient)
                return FrictionLaw(lambda points, slip: np.full(len(slip), mu), mu, 0.0)
            case fem.Constant() as constant:
                return FrictionLaw(lambda points, slip: present(constant), None, 0.0)
        return FrictionLaw(self.coefficient)

    @property
    def is_zero(self) -> bool:
        """Whether there is no friction."""
        return isinstance(self.coefficient, Real) and self.coefficient == 0.0

    def on(self, surface: ContactSurface, smoothing: Smoothing) -> FrictionBound:
        """The friction bound on a surface, with R there."""
        # Without friction nothing asks for R, whose matrix would be made for its field.
        kernel = Identity() if self.is_zero else smoothing
        return FrictionBound(surface, kernel, self.law, self.is_zero)


def default_radius(surface: ContactSurface) -> float:
    """The default radius of R; collective."""
    size = surface.domain.facet_diameter(surface.facets)
    return max(_DEFAULT_RADIUS_SHARE * _extent(surface), _DEFAULT_RADIUS_FACETS * size)


def _extent(surface: ContactSurface) -> float:
    """About the largest distance between two nodes of Gamma_C; collective.

    One end is the point farthest from the mean of the points, the other end the point farthest from
    the first.  The result is exact for a segment and a rectangle, in every position.
    """
    places: FloatArray = np.concatenate(surface.domain.comm.allgather(surface.points))
    place = places.mean(axis=0)
    for _ in range(2):
        distances = np.linalg.norm(places - place, axis=1)
        place = places[np.argmax(distances)]
    return float(distances.max())
