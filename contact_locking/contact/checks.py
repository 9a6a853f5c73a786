"""Checks of a contact as a script gives it: each part is of a kind that the problem can use."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from numbers import Real
from typing import Any

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import present
from contact_locking.contact.contact import Contact, FoundationSpring, Gap, Motion
from contact_locking.contact.coulomb import Coulomb, Kernel
from contact_locking.contact.foundation import PlacedFoundation
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.errors import InputError, with_key
from contact_locking.laws.foundation import LevelSet, Sphere
from contact_locking.laws.friction import FrictionLaw
from contact_locking.parallel import agree, on_every_rank

# The vectors of the foundations of this package.
_VECTORS = ("point", "normal", "centre", "axis")
# At this pressure, slight in every unit, a friction bound shows its sign; at 0 it may be 0.
_SLIGHT = 1e-12


def check(given: Contact, dim: int) -> None:
    """Raise InputError for a part of another kind, and say which kind would be right."""

    def require(is_right: object, part: str, wanted: str) -> None:
        if not is_right:
            raise InputError(wanted, f"{given.key}.{part}")

    for is_right, wanted in _of_foundation(given.foundation, dim):
        require(is_right, "foundation", wanted)
    friction: Any = given.friction
    require(isinstance(friction, Coulomb), "friction", "must be Coulomb(mu) or a subclass")
    _check_coefficient(friction.coefficient, require)
    smoothing: Any = friction.smoothing
    wanted = "smoothing must be Convolution(radius), Helmholtz(radius), Local() or a Kernel"
    require(isinstance(smoothing, Kernel), "friction", wanted)
    require(given.pair in ("once", "each_step"), "pair", "must be once or each_step")
    if isinstance(given.motion, Motion):
        wanted = f"translation must have {dim} components in {dim}D"
        require(np.size(present(given.motion.translation)) == dim, "motion", wanted)
    elif given.motion is not None:
        wanted = "must be a Motion, or a function without arguments that returns a RigidMotion"
        require(_is_function(given.motion), "motion", wanted)
    require(given.force is None or _has(given.force, "size"), "force", "must be a Force")
    spring: Any = given.spring
    if spring is not None:
        require(isinstance(spring, FoundationSpring), "spring", "must be a FoundationSpring")
        wanted = "give it along a line" if given.force is None else "leave out its line"
        wanted += ": it acts along the force, or along a line without a force"
        require((spring.along is None) != (given.force is None), "spring", wanted)
        if spring.along is not None:
            wanted = f"along must have {dim} components in {dim}D"
            require(np.shape(spring.along) == (dim,), "spring", wanted)
            wanted = "along must be a vector of finite length above zero"
            require(0.0 < np.linalg.norm(spring.along) < np.inf, "spring", wanted)
        require(_is_number(spring.stiffness), "spring", "stiffness must be a number")


def check_friction(contact: NodalContact) -> None:
    """Raise InputError for a mu or a user's own bound that is not from 0 up at each point.

    Both are evaluated without slip, and the bound at a slight pressure.  Collective.
    """
    law, points, comm = contact.friction.law, contact.surface.points, contact.surface.domain.comm
    key, mu = f"{contact.key}.friction", np.zeros(len(points))

    def evaluate() -> None:
        # A rank without points has no values whose shape could tell.
        if len(points):
            mu[:] = with_key(key, lambda: law(points, np.zeros(len(points))))

    agree(comm, evaluate)
    is_right = np.isfinite(mu) & (mu >= 0.0)
    if not on_every_rank(comm, is_right):
        wrong = np.concatenate(comm.allgather(mu[~is_right]))
        raise InputError(
            f"mu must be a finite number from 0 up everywhere, and is {wrong[0]:g} somewhere", key
        )
    if not contact.friction.is_coulomb:
        _check_bound(contact, key)


def _check_bound(contact: NodalContact, key: str) -> None:
    count, comm = len(contact.surface.points), contact.surface.domain.comm
    found: Any = contact.friction.evaluate(np.full(count, _SLIGHT), np.zeros(count))
    wanted = f"evaluate of {type(contact.friction).__name__} must give the friction bound (k,)"

    def require() -> None:
        if np.shape(found) != (count,):
            raise InputError(f"{wanted}, here ({count},), not the shape {np.shape(found)}", key)

    agree(comm, require)
    is_right = np.isfinite(found) & (np.asarray(found) >= 0.0)
    if not on_every_rank(comm, is_right):
        wrong = np.concatenate(comm.allgather(np.asarray(found)[~is_right]))
        raise InputError(
            f"{wanted} of finite numbers from 0 up, and is {wrong[0]:g} somewhere without slip", key
        )


def _of_foundation(body: Any, dim: int) -> Iterator[tuple[bool, str]]:
    """The conditions on a foundation, each with the message where it fails."""
    if isinstance(body, PlacedFoundation):
        return
    if isinstance(body, Gap):
        yield (
            _is_number(body.distance) or _is_function(body.distance),
            "the distance of a Gap must be a number, a constant of DOLFINx, or a function of "
            "points (d, k) such as lambda x: 0.01*x[0]",
        )
        return
    yield (
        _has(body, "gap", "contact_normal") and not isinstance(body, type),
        "must be a Gap, a shape such as Sphere(centre, radius), or an object with gap(x) "
        "and contact_normal(x)",
    )
    if isinstance(body, Sphere):
        yield body.radius > 0.0, f"its radius must be > 0, not {body.radius}"
    if isinstance(body, LevelSet):
        wanted = "a LevelSet takes a function of points (d, k) that returns f (k,) and its gradient"
        yield _is_function(body.function), wanted
    for name in _VECTORS:
        vector = getattr(body, name, None)
        if isinstance(vector, tuple | list):
            wanted = f"its {name} must have {dim} components in {dim}D, not {len(vector)}"
            yield len(vector) == dim, wanted
            wanted = f"its {name} gives a direction, and must not be zero"
            yield name not in ("normal", "axis") or any(vector), wanted


def _check_coefficient(mu: Any, require: Callable[..., None]) -> None:
    if isinstance(mu, FrictionLaw) and _is_function(mu.coefficient):
        return
    mu = mu.coefficient if isinstance(mu, FrictionLaw) else mu
    wanted = (
        "mu must be a number, a constant of DOLFINx, or a function of points (k, d) and slips "
        "(k,) such as lambda x, s: 0.1 + 0.2*x[:, 0]"
    )
    require(_is_number(mu) or _is_function(mu), "friction", wanted)
    if isinstance(mu, Real):
        require(float(mu) >= 0.0, "friction", f"mu must be >= 0, not {mu}")
        wanted = "mu must be finite: take 1e3, with which hardly anything slips"
        require(math.isfinite(float(mu)), "friction", wanted)


def _is_number(value: Any) -> bool:
    return isinstance(value, Real | fem.Constant) and not isinstance(value, bool)


def _is_function(value: Any) -> bool:
    # Expressions of UFL, among them functions of DOLFINx, can be called, but not with points.
    return callable(value) and not isinstance(value, Expr | type)


def _has(value: Any, *methods: str) -> bool:
    return all(callable(getattr(value, name, None)) for name in methods)
