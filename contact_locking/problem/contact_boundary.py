"""The contacts of a study: Gamma_C, the foundation's gap and normal, R and the friction law."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from mpi4py import MPI

from contact_locking.errors import InputError, with_key
from contact_locking.expressions import parse
from contact_locking.laws import foundation
from contact_locking.laws.friction_law import FrictionLaw
from contact_locking.parallel import agree
from contact_locking.parameters import ContactParameters, Parameters
from contact_locking.problem.coefficients import AXES, evaluate
from contact_locking.problem.conditions import Constraints
from contact_locking.problem.contact import Contact, FrictionBound
from contact_locking.problem.domain import Domain
from contact_locking.problem.plausibility import about_the_gap
from contact_locking.problem.smoothing import Convolution, HelmholtzFilter, Identity
from contact_locking.problem.smoothing import Smoothing as SmoothingOperator
from contact_locking.problem.spaces import Element
from contact_locking.problem.surface import ContactSurface

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

# Without a radius R averages over this share of the extent of Gamma_C, and over the neighbours of
# each node at least: the kernel vanishes at its radius.
_DEFAULT_RADIUS_SHARE, _DEFAULT_RADIUS_FACETS = 0.1, 2.0
# From this share of the extent on, R by a filter is the mean over Gamma_C to nine digits.
_LARGEST_RADIUS_SHARE = 1e4
# A friction coefficient is zero where it is negative by less than this share of its largest value.
_COEFFICIENT_ROUNDING = 1e-12


def build_contacts(
    domain: Domain,
    space: fem.FunctionSpace,
    constraints: Constraints,
    parameters: Parameters,
    penalty_slip: float,
    warnings: list[str],
    element: Element,
) -> tuple[Contact, ...]:
    """The contacts that the study file asks for; collective.

    ``space`` is the ``element``'s.  ``penalty_slip`` is the regularisation of friction where the
    file has none.  Raises InputError for a foundation behind Gamma_C, for a negative friction
    coefficient, and for an element that has no contact.
    """
    u = fem.Function(space)
    free_dofs = constraints.free_dofs(u)
    found = []
    for given in parameters.contacts:
        surface = ContactSurface(domain, space, given.on, f"{given.key}.on", element)
        gap, normals = _foundation_from(surface, given)
        kind = "gap" if given.foundation is None else "foundation"
        warnings += about_the_gap(domain, gap, f"{given.key}.{kind}")
        free = surface.free_nodes(normals, free_dofs)
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
                gap=surface.scalar_function(gap, "gap"),
                friction=bound,
                regularisation=fem.Constant(domain.mesh, slip),
                free=free,
            )
        )
    return tuple(found)


def _foundation_from(
    surface: ContactSurface, given: ContactParameters
) -> tuple[FloatArray, FloatArray]:
    """The gap (k,) to the foundation and the contact normal (k, d) at the nodes; collective."""
    comm, dim, points = surface.domain.comm, surface.domain.dim, surface.points.T
    body_normals = surface.body_normals()
    if given.foundation is None:
        return evaluate(comm, given.gap, points, f"{given.key}.gap"), body_normals
    body, key = _foundation(given, dim), f"{given.key}.foundation"
    with np.errstate(all="ignore"):
        gap, normals = body.gap(points), body.contact_normal(points).T
    finite = bool(np.isfinite(gap).all() and np.isfinite(normals).all())
    if not comm.allreduce(finite, op=MPI.LAND):
        raise InputError(
            "the distance to it is no number; it lies too far away or is too large", key
        )
    facing = np.sum(normals * body_normals, axis=1)
    if comm.allreduce(bool(np.any(facing <= 0.0)), op=MPI.LOR):
        raise InputError(
            "the foundation lies behind a part of Gamma_C: there the outward normal of the "
            "body points away from it; turn the half space's normal towards the body, or "
            f"take away from {given.key}.on what does not face the foundation",
            key,
        )
    return gap, normals


def _foundation(given: ContactParameters, dim: int) -> foundation.Foundation:
    assert given.foundation is not None
    half_space, sphere, cylinder = (
        given.foundation.half_space,
        given.foundation.sphere,
        given.foundation.cylinder,
    )
    if half_space is not None:
        return foundation.HalfSpace(tuple(half_space.point), tuple(half_space.normal))
    if sphere is not None:
        return foundation.Round(tuple(sphere.centre), sphere.radius)
    assert cylinder is not None
    axis = None if dim == 2 else tuple(cylinder.axis or (0.0, 1.0, 0.0))
    return foundation.Round(tuple(cylinder.centre), cylinder.radius, axis)


def _smoothing(
    surface: ContactSurface, free: BoolArray, part: ContactParameters, warnings: list[str]
) -> SmoothingOperator:
    given = part.friction.smoothing
    if given.kernel == "none":
        return Identity()
    comm = surface.domain.comm
    radius = given.radius
    size = surface.domain.facet_diameter(surface.facets)
    places = np.concatenate(comm.allgather(surface.points))
    extent = _extent(places)
    if radius is None:
        radius = max(_DEFAULT_RADIUS_SHARE * extent, _DEFAULT_RADIUS_FACETS * size)
    elif radius < size:
        key = part.friction_key("smoothing.radius")
        warnings.append(
            f"{key}: {radius:g} is smaller than the mesh size {size:.3g} on "
            "Gamma_C, so R hardly smooths; refine the mesh there or enlarge the radius"
        )
    if given.kernel == "convolution":
        return Convolution(comm, surface.whole(free), radius)
    radius = min(radius, _LARGEST_RADIUS_SHARE * extent)
    return HelmholtzFilter(comm, surface.whole(free), surface.laplacian(), radius)


def _extent(places: FloatArray) -> float:
    """How far apart points (k, d) are: from the one farthest from the middle to that from it.

    Of a straight or rectangular Gamma_C the length or diagonal, however it lies.
    """
    place = places.mean(axis=0)
    for _ in range(2):
        distances = np.linalg.norm(places - place, axis=1)
        place = places[np.argmax(distances)]
    return float(distances.max())


def _friction_law(comm: MPI.Intracomm, part: ContactParameters) -> FrictionLaw:
    """``mu(x, s)`` of a number or an expression; to evaluate it is collective."""
    key = part.friction_key("coefficient")
    expression = parse(part.friction.coefficient, (*AXES, "s"))

    def local(points: FloatArray, slip: FloatArray) -> FloatArray:
        places = dict(zip(AXES, points.T, strict=False))
        return with_key(
            key, lambda: np.broadcast_to(expression.numpy(**places, s=slip), slip.shape)
        )

    def whole(points: FloatArray, slip: FloatArray) -> FloatArray:
        mu = agree(comm, lambda: local(points, slip))
        # Zero, computed from other numbers, may come out below zero by their rounding.
        least = -_COEFFICIENT_ROUNDING * comm.allreduce(np.abs(mu).max(initial=0.0), op=MPI.MAX)
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
    """Raise InputError, with the place, if a friction coefficient is below ``least``."""
    if not np.any(mu < least):
        return
    worst = int(np.argmin(mu))
    where = [f"{axis} = {place:.6g}" for axis, place in zip(AXES, points[worst], strict=False)]
    raise InputError(
        f"the friction coefficient must not be negative, it is {mu[worst]:g} at "
        f"{', '.join(where)}, s = {slip[worst]:.6g}",
        key,
    )
