"""Coulomb's friction of one contact: the bound of its traction, and the smoothing R."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from contact_locking.arrays import AXES, BoolArray, FloatArray, IntArray
from contact_locking.contact.smoothing import (
    ConvolutionOperator,
    HelmholtzOperator,
    Identity,
    Smoothing,
)
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import InputError, NotConverged, with_key
from contact_locking.laws.friction import Coefficient, FrictionLaw
from contact_locking.parallel import agree, maximum
from contact_locking.values.value import Value

# The default radius of R is this share of the extent of Gamma_C.  It is at least twice the longest
# facet: the kernel vanishes at the radius, and R has to reach the neighbours of each node.
_DEFAULT_RADIUS_SHARE, _DEFAULT_RADIUS_FACETS = 0.1, 2.0
# A negative friction coefficient smaller than this share of the largest value is zero with
# rounding.
_ROUNDING = 1e-12
# A filter with a larger radius than this share of the extent is the mean over Gamma_C to nine
# digits.
_LARGEST_RADIUS_SHARE = 1e4
# The central differences of mu take steps of this share of the slip.
_DIFFERENCE = 1e-3


class FrictionBound:
    """``G(p, s) = mu(x, s) |R p|`` (6): the bound of the friction traction at the nodes.

    ``law`` maps points (k, d) and accumulated slips s (k,) to ``mu`` (k,): the coefficient of
    a :class:`Coulomb`, a :class:`~contact_locking.laws.friction.FrictionLaw`, or a function, for
    which the certificate samples mu* and L_mu.  ``smoothing`` is R.  ``frictionless`` says that
    mu is zero everywhere.  A user's own friction bound is a subclass with another :meth:`evaluate`.
    """

    #: The name of the coefficient in messages.
    key = "friction.coefficient"

    def __init__(
        self,
        surface: ContactSurface,
        smoothing: Smoothing,
        law: FrictionLaw | Coefficient | Value | None,
        frictionless: bool = False,
    ) -> None:
        self.surface, self.smoothing, self.frictionless = surface, smoothing, frictionless
        self.law = law_of(law, surface.domain.comm)

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        """The friction bound (k,) at the owned nodes; collective.

        ``pressure`` (k,) is ``-sigma_nu``, and ``slip`` (k,) is the accumulated slip.
        """
        return self.coefficient(slip) * np.abs(self.smoothing.apply(pressure))

    def coefficient(self, slip: FloatArray) -> FloatArray:
        """``mu(x, s)`` (k,) at the nodes; collective."""
        return with_key(self.key, lambda: self.law(self.surface.points, slip))

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


def law_of(mu: FrictionLaw | Coefficient | Value | None, comm: MPI.Intracomm) -> FrictionLaw:
    """The law of a coefficient mu with its constants; None is no friction."""
    if mu is None:
        return FrictionLaw(lambda points, slip: np.zeros(len(slip)), 0.0, 0.0)
    data: Any = mu.data if isinstance(mu, Value) else mu
    if isinstance(mu, Value) and mu.number is not None:
        number = mu.number
        return FrictionLaw(lambda points, slip: np.full(len(slip), number), number, 0.0)
    if isinstance(mu, Value) and mu.expression is not None:
        lipschitz = None if "s" in mu.expression.names else 0.0
        return FrictionLaw(partial(_of_expression, comm, mu), None, lipschitz)
    if isinstance(data, fem.Constant):
        return FrictionLaw(lambda points, slip: data.value, None, 0.0)
    return data if isinstance(data, FrictionLaw) else FrictionLaw(data)


def _of_expression(
    comm: MPI.Intracomm, mu: Value, points: FloatArray, slip: FloatArray
) -> FloatArray:
    """``mu(x, s)`` (k,) of an expression; collective."""

    def local() -> FloatArray:
        try:
            return mu.at(points.T, s=slip)
        except InputError as error:
            # An iterate may slip farther than the solution, beyond the end of a table.
            if slip.any():
                raise NotConverged(f"the friction coefficient: {error}") from error
            raise

    found = agree(comm, local)
    # An expression that is zero may evaluate to less than zero by rounding.
    least = -_ROUNDING * maximum(comm, np.abs(found))
    agree(comm, lambda: _refuse_negative(found, least, points, slip))
    return np.maximum(found, 0.0)


def _refuse_negative(mu: FloatArray, least: float, points: FloatArray, slip: FloatArray) -> None:
    """Raise InputError, with the point, if a friction coefficient is below ``least``."""
    if not np.any(mu < least):
        return
    worst = int(np.argmin(mu))
    where = [f"{axis} = {place:.6g}" for axis, place in zip(AXES, points[worst], strict=False)]
    raise InputError(
        f"the friction coefficient must not be negative, it is {mu[worst]:g} at "
        f"{', '.join(where)}, s = {slip[worst]:.6g}"
    )


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


def operator_of(
    kernel: str | None,
    radius: float | None,
    surface: ContactSurface,
    free: BoolArray,
    sides: IntArray,
) -> Smoothing:
    """R of a standard kernel on a surface; collective.  The arguments are those of `Kernel.on`."""
    if kernel == "none":
        return Identity()
    comm, whole = surface.domain.comm, surface.whole(free, sides)
    radius = default_radius(surface) if radius is None else radius
    if kernel == "helmholtz":
        radius = min(radius, _LARGEST_RADIUS_SHARE * _extent(surface))
        return HelmholtzOperator(comm, whole, surface.laplacian(sides), radius)
    return ConvolutionOperator(comm, whole, radius)
