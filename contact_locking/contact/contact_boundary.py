"""The contacts of a study: Gamma_C, gap and normal of the foundation, R and the friction law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from dolfinx import fem

from contact_locking.arrays import AXES, BoolArray, FloatArray, IntArray
from contact_locking.contact.contact import Contact, FrictionBound
from contact_locking.contact.obstacles import obstacle_of
from contact_locking.contact.smoothing import Convolution, HelmholtzFilter, Identity
from contact_locking.contact.smoothing import Smoothing as SmoothingOperator
from contact_locking.contact.surface import ContactSurface
from contact_locking.errors import InputError, with_key
from contact_locking.expressions import parse
from contact_locking.fem.spaces import Element
from contact_locking.fields.clock import Clock
from contact_locking.fields.plausibility import about_the_gap
from contact_locking.fields.sampling import Entities, features
from contact_locking.laws.friction_law import FrictionLaw
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import agree, maximum, on_any_rank
from contact_locking.parameters import ContactParameters, Parameters
from contact_locking.supports.conditions import Constraints

# The default radius of R is this share of the extent of Gamma_C.  It is at least twice the longest
# facet: the kernel vanishes at the radius, and R has to reach the neighbours of each node.
_DEFAULT_RADIUS_SHARE, _DEFAULT_RADIUS_FACETS = 0.1, 2.0
# A filter with a larger radius than this share of the extent is the mean over Gamma_C to nine
# digits.
_LARGEST_RADIUS_SHARE = 1e4
# The sizes of facets have rounding errors: at a radius of just one facet R does nothing.
_SIZE_ROUNDING = 1e-9
# A negative friction coefficient smaller than this share of the largest value is zero with
# rounding.
_COEFFICIENT_ROUNDING = 1e-12


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
        obstacle = obstacle_of(domain.comm, domain.dim, given, clock)
        gap, normals = obstacle.at_nodes(surface)
        kind = "gap" if given.foundation is None else "foundation"
        warnings += about_the_gap(domain, gap, f"{given.key}.{kind}")
        warnings += obstacle.warnings(surface, gap)
        free = surface.free_nodes(normals, constraints)
        regularisation = given.friction.regularisation
        bound = FrictionBound(
            surface,
            _smoothing(surface, free, surface.sides(normals), given, warnings),
            _friction_law(surface, given, clock, warnings),
            frictionless=given.friction.coefficient == 0,
        )
        slip = penalty_slip if regularisation is None else regularisation
        contact = Contact(
            key=given.key,
            on=given.on,
            surface=surface,
            obstacle=obstacle,
            normal=surface.vector_function(normals, "contact_normal"),
            gap=surface.scalar_function(surface.limited_gap(gap), "gap"),
            friction=bound,
            regularisation=fem.Constant(domain.mesh, slip),
            free=free,
        )
        if obstacle.moves:
            contact.place_obstacle(contact.gaps, normals, obstacle.drag(surface, None))
        found.append(contact)
    return tuple(found)


@dataclass
class MovingGap:
    """The gap, the normal and the drag of a contact whose obstacle depends on the time.

    ``given`` is what the study file says.  ``since`` is the time of the last step that has ended,
    None before the first.
    """

    contact: Contact
    given: ContactParameters
    clock: Clock
    constraints: Constraints
    since: float | None = None

    def __post_init__(self) -> None:
        self._sides = self.contact.surface.sides(self.contact.normals)

    def advance(self) -> None:
        """Put gap, normal and drag to the present time; collective.

        Raises Misplaced for a foundation that has moved behind Gamma_C.
        """
        contact, surface = self.contact, self.contact.surface
        gap, normals = contact.obstacle.at_nodes(surface)
        drag = contact.obstacle.drag(surface, self.since)
        contact.place_obstacle(surface.limited_gap(gap), normals, drag)
        if not contact.obstacle.moves:
            return
        free, sides = surface.free_nodes(normals, self.constraints), surface.sides(normals)
        is_other = on_any_rank(surface.domain.comm, free != contact.free)
        if is_other or np.any(sides != self._sides):
            # R leaves out the nodes that are not free, and each side is averaged alone.
            contact.friction.smoothing.destroy()
            contact.friction.smoothing = _smoothing(surface, free, sides, self.given, [])
            contact.free, self._sides = free, sides

    def end_step(self) -> None:
        """The step has ended; the next one begins at the present time."""
        self.since = self.clock.now


def moving_gaps(
    contacts: Sequence[Contact], parameters: Parameters, constraints: Constraints, clock: Clock
) -> list[MovingGap]:
    """The gaps of the contacts with obstacles that depend on the time."""
    pairs = zip(contacts, parameters.contacts, strict=True)
    return [
        MovingGap(contact, given, clock, constraints)
        for contact, given in pairs
        if contact.obstacle.is_timed
    ]


def _smoothing(
    surface: ContactSurface,
    free: BoolArray,
    sides: IntArray,
    part: ContactParameters,
    warnings: list[str],
) -> SmoothingOperator:
    given = part.friction.smoothing
    if given.kernel == "none":
        return Identity()
    domain = surface.domain
    comm, radius = domain.comm, given.radius
    size = domain.facet_diameter(surface.facets)
    if radius is None:
        radius = domain.smoothing_radii.get(part.key) or default_radius(surface)
    elif radius <= size * (1.0 + _SIZE_ROUNDING):
        key = part.friction_key("smoothing.radius")
        warnings.append(
            f"{key}: {radius:g} is not larger than the mesh size {size:.3g} on "
            f"{', '.join(part.on)}, so R hardly smooths; refine the mesh there or enlarge the "
            "radius"
        )
    if given.kernel == "convolution":
        return Convolution(comm, surface.whole(free, sides), radius)
    radius = min(radius, _LARGEST_RADIUS_SHARE * _extent(surface))
    return HelmholtzFilter(comm, surface.whole(free, sides), surface.laplacian(sides), radius)


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


def _friction_law(
    surface: ContactSurface, part: ContactParameters, clock: Clock, warnings: list[str]
) -> FrictionLaw:
    """``mu(x, s)`` from a number or an expression; every evaluation is collective."""
    domain, key = surface.domain, part.friction_key("coefficient")
    comm = domain.comm
    expression = parse(part.friction.coefficient, (*AXES, "s"), tables=clock.tables)
    facets = Entities.of(domain, domain.dim - 1, surface.facets)
    warnings += features(facets, expression, key, "refine the mesh there", s=0.0)

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
