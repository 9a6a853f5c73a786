"""Checks of a contact as a script gives it: each part is of a kind that the problem can use."""

from __future__ import annotations

import math
from collections.abc import Iterator
from numbers import Real
from typing import Any

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import present
from contact_locking.contact.contact import Contact, FoundationSpring, Gap, Motion, Tilt
from contact_locking.contact.coulomb import Coulomb
from contact_locking.contact.foundation import PlacedFoundation
from contact_locking.contact.nodal_contact import NodalContact
from contact_locking.errors import InputError, with_key
from contact_locking.laws.foundation import LevelSet, Round
from contact_locking.laws.friction import FrictionLaw
from contact_locking.parallel import agree, minimum

# The vectors of the foundations of this package.
_VECTORS = ("point", "normal", "centre", "axis")


def check(given: Contact, dim: int) -> None:
    """Raise InputError for a part of another kind, and say which kind would be right."""
    for part, fault in _faults(given, dim):
        raise InputError(fault, f"{given.key}.{part}")


def check_friction(contact: NodalContact) -> None:
    """Raise InputError for a mu without slip that is not a number from 0 up at each point.

    Collective.
    """
    law, points, comm = contact.friction.law, contact.surface.points, contact.surface.domain.comm
    key, mu = f"{contact.key}.friction", np.zeros(len(points))

    def evaluate() -> None:
        # A rank without points has no values whose shape could tell.
        if len(points):
            mu[:] = with_key(key, lambda: law(points, np.zeros(len(points))))

    agree(comm, evaluate)
    least = minimum(comm, np.nan_to_num(mu, nan=-np.inf))
    if not least >= 0.0:
        raise InputError(
            f"mu must be a number from 0 up everywhere, and is {least:g} somewhere", key
        )


def _faults(given: Contact, dim: int) -> Iterator[tuple[str, str]]:
    for fault in _of_foundation(given.foundation, dim):
        yield "foundation", fault
    friction: Any = given.friction
    if isinstance(friction, Coulomb):
        for fault in _of_coefficient(friction.coefficient):
            yield "friction", fault
    else:
        yield "friction", f"must be Coulomb(mu) or a subclass, not {_shown(friction)}"
    if given.pair not in ("once", "each_step"):
        yield "pair", f"must be once or each_step, not {_shown(given.pair)}"
    elif given.pair == "each_step" and given.against is None:
        yield "pair", "is about two bodies; name the other one in against, or leave out pair"
    if isinstance(given.motion, Motion):
        if np.size(present(given.motion.translation)) != dim:
            yield "motion", f"translation must have {dim} components in {dim}D"
    elif given.motion is not None and not _is_function(given.motion):
        wanted = "a Motion, or a function without arguments that returns a RigidMotion"
        yield "motion", f"must be {wanted}, not {_shown(given.motion)}"
    if given.force is not None and not _has(given.force, "size"):
        yield "force", f"must be a Force, not {_shown(given.force)}"
    yield from _of_holders(given, dim)


def _of_holders(given: Contact, dim: int) -> Iterator[tuple[str, str]]:
    """The faults of spring and tilt."""
    spring: Any = given.spring
    tilt: Any = given.tilt
    if spring is not None:
        if not isinstance(spring, FoundationSpring):
            yield "spring", f"must be a FoundationSpring, not {_shown(spring)}"
        elif (spring.along is None) == (given.force is None):
            wanted = "give it along a line" if given.force is None else "leave out its line"
            yield "spring", f"{wanted}: it acts along the force, or along a line without a force"
        elif spring.along is not None and np.shape(spring.along) != (dim,):
            yield "spring", f"along must have {dim} components in {dim}D"
        elif spring.along is not None and not 0.0 < np.linalg.norm(spring.along) < np.inf:
            yield "spring", "along must be a vector of finite length above zero"
        elif not _is_number(spring.stiffness):
            yield "spring", f"stiffness must be a number, not {_shown(spring.stiffness)}"
    if tilt is not None:
        if not isinstance(tilt, Tilt):
            yield "tilt", f"must be a Tilt, not {_shown(tilt)}"
        elif np.shape(present(tilt.about)) != (dim,):
            yield "tilt", f"about must have {dim} components in {dim}D"
        elif not _is_number(tilt.stiffness):
            yield "tilt", f"stiffness must be a number, not {_shown(tilt.stiffness)}"


def _of_foundation(body: Any, dim: int) -> Iterator[str]:
    if isinstance(body, Gap):
        if not (_is_number(body.distance) or _is_function(body.distance)):
            yield (
                "the distance of a Gap must be a number, a constant of DOLFINx, or a function of "
                f"points (d, k) such as lambda x: 0.01*x[0], not {_shown(body.distance)}"
            )
    elif not isinstance(body, PlacedFoundation):
        if not _has(body, "gap", "contact_normal"):
            yield (
                "must be a Gap, a shape such as Sphere(centre, radius), or an object with gap(x) "
                f"and contact_normal(x), not {_shown(body)}"
            )
        if isinstance(body, Round) and not body.radius > 0.0:
            yield f"its radius must be > 0, not {body.radius}"
        if isinstance(body, LevelSet) and not _is_function(body.function):
            wanted = "a function of points (d, k) that returns f (k,) and its gradient (d, k)"
            yield f"a LevelSet takes {wanted}, not {_shown(body.function)}"
        for name in _VECTORS:
            vector = getattr(body, name, None)
            if isinstance(vector, tuple | list) and len(vector) != dim:
                yield f"its {name} must have {dim} components in {dim}D, not {len(vector)}"


def _of_coefficient(mu: Any) -> Iterator[str]:
    if isinstance(mu, FrictionLaw):
        mu = mu.coefficient
        if _is_function(mu):
            return
    if _is_number(mu):
        if isinstance(mu, Real) and (math.isnan(mu) or mu < 0.0):
            yield f"mu must be >= 0, not {mu}"
    elif not _is_function(mu):
        yield (
            "mu must be a number, a constant of DOLFINx, or a function of points (k, d) and slips "
            f"(k,) such as lambda x, s: 0.1 + 0.2*x[:, 0], not {_shown(mu)}"
        )


def _is_number(value: Any) -> bool:
    return isinstance(value, Real | fem.Constant) and not isinstance(value, bool)


def _is_function(value: Any) -> bool:
    # Expressions of UFL, among them functions of DOLFINx, can be called, but not with points.
    return callable(value) and not isinstance(value, Expr | type)


def _has(value: Any, *methods: str) -> bool:
    return all(callable(getattr(value, name, None)) for name in methods)


def _shown(value: Any) -> str:
    """A value by its kind, and itself if that is short."""
    kind, text = type(value).__name__, repr(value)
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, Expr):
        return f"an expression of UFL ({kind})"
    return f"{kind} {text}" if len(text) <= 40 else kind
