"""The contacts of a study: Gamma_C, gap and normal of the foundation, R and the friction law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI

from contact_locking.arrays import AXES, BoolArray, FloatArray
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import TIME, parse
from contact_locking.laws.foundation import Foundation, HalfSpace, Round
from contact_locking.laws.friction_law import FrictionLaw
from contact_locking.parallel import agree, maximum, on_any_rank, on_every_rank
from contact_locking.parameters import ContactParameters, Parameters, rigid_body
from contact_locking.problem.clock import Clock, is_timed
from contact_locking.problem.coefficients import evaluate
from contact_locking.problem.conditions import Constraints
from contact_locking.problem.contact import Contact, FrictionBound
from contact_locking.problem.domain import Domain
from contact_locking.problem.plausibility import about_the_gap
from contact_locking.problem.smoothing import Convolution, HelmholtzFilter, Identity
from contact_locking.problem.smoothing import Smoothing as SmoothingOperator
from contact_locking.problem.spaces import Element
from contact_locking.problem.surface import ContactSurface

# The default radius of R is this share of the extent of Gamma_C.  It is at least twice the longest
# facet: the kernel vanishes at the radius, and R has to reach the neighbours of each node.
_DEFAULT_RADIUS_SHARE, _DEFAULT_RADIUS_FACETS = 0.1, 2.0
# A filter with a larger radius than this share of the extent is the mean over Gamma_C to nine
# digits.
_LARGEST_RADIUS_SHARE = 1e4
# A negative friction coefficient smaller than this share of the largest value is zero with
# rounding.
_COEFFICIENT_ROUNDING = 1e-12


def _half_space(given: rigid_body.HalfSpace, dim: int) -> Foundation:
    return HalfSpace(given.point, given.normal)


def _sphere(given: rigid_body.Sphere, dim: int) -> Foundation:
    return Round(given.centre, given.radius)


def _cylinder(given: rigid_body.Cylinder, dim: int) -> Foundation:
    return Round(given.centre, given.radius, None if dim == 2 else given.axis or (0.0, 1.0, 0.0))


#: For each key of a section ``foundation``: the foundation of that section in 2 or 3 dimensions.
FOUNDATIONS: dict[str, Callable[[Any, int], Foundation]] = {
    "half_space": _half_space,
    "sphere": _sphere,
    "cylinder": _cylinder,
}


def build_contacts(
    domain: Domain,
    space: fem.FunctionSpace,
    constraints: Constraints,
    parameters: Parameters,
    penalty_slip: float,
    warnings: list[str],
    element: Element,
    clock: Clock,
) -> tuple[Contact, ...]:
    """The contacts that the study file asks for; collective.

    ``space`` is the displacement space of ``element``.  ``penalty_slip`` is the regularisation of
    friction for a contact that has none in the file.  Raises InputError for a foundation behind
    Gamma_C, for a negative friction coefficient, and for an element that has no contact.
    """
    limited = element.trace.limited_space(space)
    found = []
    for given in parameters.contacts:
        surface = ContactSurface(domain, space, given.on, f"{given.key}.on", element, limited)
        gap, normals = _foundation_from(surface, given, clock.now)
        kind = "gap" if given.foundation is None else "foundation"
        warnings += about_the_gap(domain, gap, f"{given.key}.{kind}")
        free = surface.free_nodes(normals, constraints)
        regularisation = given.friction.regularisation
        bound = FrictionBound(
            surface,
            _smoothing(surface, free, given, warnings),
            _friction_law(domain.comm, given),
            frictionless=given.friction.coefficient == 0,
        )
        slip = penalty_slip if regularisation is None else regularisation
        found.append(
            Contact(
                key=given.key,
                on=given.on,
                surface=surface,
                normal=surface.vector_function(normals, "contact_normal"),
                gap=_limited_gap(surface, gap),
                friction=bound,
                regularisation=fem.Constant(domain.mesh, slip),
                free=free,
            )
        )
    return tuple(found)


@dataclass(frozen=True)
class MovingGap:
    """The gap of a contact whose foundation depends on the time."""

    contact: Contact
    given: ContactParameters
    clock: Clock

    def advance(self) -> None:
        """Evaluate the gap at the present time; collective."""
        self.contact.gaps = _foundation_from(self.contact.surface, self.given, self.clock.now)[0]


def moving_gaps(
    contacts: Sequence[Contact], parameters: Parameters, clock: Clock
) -> list[MovingGap]:
    """The gaps that depend on the time."""
    pairs = zip(contacts, parameters.contacts, strict=True)
    return [
        MovingGap(contact, given, clock)
        for contact, given in pairs
        if is_timed(parse(given.gap, (*AXES, TIME)))
    ]


def _foundation_from(
    surface: ContactSurface, given: ContactParameters, time: float
) -> tuple[FloatArray, FloatArray]:
    """The gap (k,) to the foundation and the contact normal (k, d) at the nodes; collective."""
    comm, dim, points = surface.domain.comm, surface.domain.dim, surface.points.T
    body_normals = surface.body_normals()
    if given.foundation is None:
        gap = evaluate(comm, given.gap, points, f"{given.key}.gap", time=time)
        return gap, body_normals
    shape, section = next(entry for entry in given.foundation if entry[1] is not None)
    body, key = FOUNDATIONS[shape](section, dim), f"{given.key}.foundation"
    with np.errstate(all="ignore"):
        gap, normals = body.gap(points), body.contact_normal(points).T
    if not on_every_rank(comm, np.isfinite(gap) & np.isfinite(normals).all(axis=1)):
        raise InputError(
            "its distance is not a finite number: the foundation is too far away or too large", key
        )
    facing = np.sum(normals * body_normals, axis=1)
    if on_any_rank(comm, facing <= 0.0):
        raise InputError(
            "the foundation lies behind a part of Gamma_C, where the outward normal of the body "
            "points away from the foundation; turn the normal of the half space towards the body, "
            f"or remove from {given.key}.on the boundary parts that do not face the foundation",
            key,
        )
    return gap, normals


def _limited_gap(surface: ContactSurface, gap: FloatArray) -> fem.Function:
    """The limited values of the gap (k,) as values at the nodes; collective."""
    function = surface.scalar_function(gap, "gap")
    function.x.array[surface.nodes] = surface.limited.of_function(function)
    function.x.scatter_forward()
    return function


def _smoothing(
    surface: ContactSurface, free: BoolArray, part: ContactParameters, warnings: list[str]
) -> SmoothingOperator:
    given = part.friction.smoothing
    if given.kernel == "none":
        return Identity()
    domain = surface.domain
    comm, radius = domain.comm, given.radius
    size = domain.facet_diameter(surface.facets)
    if radius is None:
        radius = domain.smoothing_radii.get(part.key) or default_radius(surface)
    elif radius < size:
        key = part.friction_key("smoothing.radius")
        warnings.append(
            f"{key}: {radius:g} is smaller than the mesh size {size:.3g} on "
            f"{', '.join(part.on)}, so R hardly smooths; refine the mesh there or enlarge the "
            "radius"
        )
    if given.kernel == "convolution":
        return Convolution(comm, surface.whole(free), radius)
    radius = min(radius, _LARGEST_RADIUS_SHARE * _extent(surface))
    return HelmholtzFilter(comm, surface.whole(free), surface.laplacian(), radius)


def default_radius(surface: ContactSurface) -> float:
    """The radius of R for a study that gives none; collective."""
    size = surface.domain.facet_diameter(surface.facets)
    return max(_DEFAULT_RADIUS_SHARE * _extent(surface), _DEFAULT_RADIUS_FACETS * size)


def _extent(surface: ContactSurface) -> float:
    """About the largest distance between two nodes of Gamma_C; collective.

    One end is the point farthest from the mean of the points, the other end the point farthest from
    the first.  The result is exact for a segment and a rectangle, in every position.
    """
    places = np.concatenate(surface.domain.comm.allgather(surface.points))
    place = places.mean(axis=0)
    for _ in range(2):
        distances = np.linalg.norm(places - place, axis=1)
        place = places[np.argmax(distances)]
    return float(distances.max())


def _friction_law(comm: MPI.Intracomm, part: ContactParameters) -> FrictionLaw:
    """``mu(x, s)`` from a number or an expression; every evaluation is collective."""
    key = part.friction_key("coefficient")
    expression = parse(part.friction.coefficient, (*AXES, "s"))

    def local(points: FloatArray, slip: FloatArray) -> FloatArray:
        places = dict(zip(AXES, points.T, strict=False))
        return with_key(
            key, lambda: np.broadcast_to(expression.numpy(**places, s=slip), slip.shape)
        )

    def whole(points: FloatArray, slip: FloatArray) -> FloatArray:
        mu = agree(comm, lambda: local(points, slip))
        # An expression that is zero may evaluate to less than zero by rounding.
        least = -_COEFFICIENT_ROUNDING * maximum(comm, np.abs(mu))
        agree(comm, lambda: _refuse_negative(mu, least, points, slip, key))
        return np.maximum(mu, 0.0)

    return FrictionLaw(
        whole,
        largest=float(expression.numpy()) if expression.is_constant else None,
        lipschitz=None if "s" in expression.names else 0.0,
    )


def _refuse_negative(
    mu: FloatArray, least: float, points: FloatArray, slip: FloatArray, key: str
) -> None:
    """Raise InputError, with the point, if a friction coefficient is below ``least``."""
    if not np.any(mu < least):
        return
    worst = int(np.argmin(mu))
    where = [f"{axis} = {place:.6g}" for axis, place in zip(AXES, points[worst], strict=False)]
    raise InputError(
        f"the friction coefficient must not be negative, it is {mu[worst]:g} at "
        f"{', '.join(where)}, s = {slip[worst]:.6g}",
        key,
    )
