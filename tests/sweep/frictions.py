"""Families of friction: large, steep, local, smoothed over little or very much."""

from __future__ import annotations

import math
from typing import Any

from .case import Case, Random, Truth, down, family, strain_size, study


def _clamped(random: Random, dim: int, friction: Any, smoothing: Any, **more: Any) -> Case:
    limit = random.limit()
    size = strain_size(limit)
    data = study(
        random.unit_block(dim, **more),
        random.held_and_pressed(dim, size * random.between(0.3, 3.0)),
        limit=limit,
        gap=random.pick([0.0, 0.1 * size]),
        friction=friction,
        smoothing=smoothing,
    )
    return Case(data, Truth(admissible=True))


@family
def large_friction(random: Random) -> Case:
    """mu from 1.5 to 8 on a clamped block."""
    dim = random.pick([2, 2, 3])
    return _clamped(random, dim, random.between(1.5, 8.0), random.kernel())


@family
def sliding_block(random: Random) -> Case:
    """A flat block whose top is pushed far along the foundation: all of it slips."""
    mesh = {"builder": "block", "dim": 2, "size": [2.0, 0.5], "h": 0.125, "structured": True}
    push = {"on": "top", "value": [random.between(0.05, 0.3), -0.01]}
    data = study(
        mesh,
        {"displacements": [push]},
        poisson=random.pick([0.0, 0.2]),
        friction=random.pick([0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 8.0]),
        smoothing={"kernel": "convolution", "radius": 0.2},
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def steep_slip(random: Random) -> Case:
    """mu that falls or rises within a small slip."""
    top, drop = random.pick([0.3, 0.6]), random.pick([0.1, 0.25, -0.4])
    length = random.decades(-5.0, -1.0)
    law = f"{top} - {drop}*s/(s + {length})"
    return _clamped(random, random.pick([2, 2, 3]), law, random.kernel())


@family
def hardening_slip(random: Random) -> Case:
    """mu that rises with the slip, of a body that is clamped or that friction alone holds."""
    low, rise, length = (
        random.between(0.05, 0.3),
        random.between(0.1, 1.0),
        random.decades(-4, -1),
    )
    if random.chance():
        law = f"{low} + {rise}*min(s/{length}, 1)"
        return _clamped(random, random.pick([2, 2, 3]), law, random.kernel())
    # Poisson's ratio is 0, so that pressure and shear stress are the same in all places below.
    share, pressure = random.between(0.1, 0.9), 0.02
    push = (low + share * rise) * pressure
    mesh = random.unit_block(random.pick([2, 2, 3]))
    dim = mesh["dim"]
    loads = {
        "tractions": [
            {"on": "top", "value": down(dim, pressure)},
            {"on": "bottom", "value": [push, *[0.0] * (dim - 1)]},
        ]
    }
    data = study(
        mesh,
        loads,
        poisson=0.0,
        friction=f"{low} + {rise}*min(s/{length}, 1)",
        smoothing={"kernel": "convolution", "radius": 0.6},
    )
    slip = (share * length, *[0.0] * (dim - 2))
    return Case(data, Truth(admissible=True, touches=True, slip=slip))


@family
def friction_in_space(random: Random) -> Case:
    """mu that varies along Gamma_C, is zero in places, or -1e-18 by rounding."""
    law = random.pick(["0.5*x", "0.6*(1 - x)", "0.8 if x < 0.47 else 0", "0.3 + 0.3*sin(6*x)"])
    dim = random.pick([2, 3])
    return _clamped(random, dim, law, random.kernel())


@family
def local_coulomb_2d(random: Random) -> Case:
    """R is the identity."""
    return _clamped(random, 2, random.between(0.1, 1.2), {"kernel": "none"}, fine=True)


@family
def local_coulomb_3d(random: Random) -> Case:
    """R is the identity, in space."""
    return _clamped(random, 3, random.between(0.1, 1.0), {"kernel": "none"}, fine=True)


@family
def smoothing_radius(random: Random) -> Case:
    """Kernels from a quarter of an element to a thousand bodies wide."""
    kernel = random.pick(["convolution", "helmholtz"])
    smoothing = {"kernel": kernel, "radius": random.decades(-1.3, 3.0)}
    return _clamped(random, random.pick([2, 2, 3]), random.between(0.1, 1.0), smoothing)


@family
def pushed_along(random: Random) -> Case:
    """A top that is pressed and pushed by prescribed displacements: stick and slip."""
    dim, limit = random.pick([2, 2, 3]), random.pick([math.inf, 0.05])
    size = 0.3 * strain_size(limit)
    value = random.downwards(dim, size)
    data = study(
        random.unit_block(dim),
        {"displacements": [{"on": "top", "value": value}]},
        limit=limit,
        friction=random.between(0.1, 1.0),
        smoothing=random.kernel(),
    )
    return Case(data, Truth(touches=True))
