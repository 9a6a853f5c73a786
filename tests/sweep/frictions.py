"""Families of friction: large, steep, local, smoothed over little or very much."""

from __future__ import annotations

import math
from typing import Any

from .case import (
    Case,
    Random,
    Truth,
    between,
    chance,
    decades,
    down,
    downwards,
    family,
    held_and_pressed,
    pick,
    some_kernel,
    some_limit,
    strain_size,
    study,
    unit_block,
)


def _clamped(random: Random, dim: int, friction: Any, smoothing: Any, **more: Any) -> Case:
    limit = some_limit(random)
    size = strain_size(limit)
    data = study(
        unit_block(random, dim, **more),
        held_and_pressed(random, dim, size * between(random, 0.3, 3.0)),
        limit=limit,
        gap=pick(random, [0.0, 0.1 * size]),
        friction=friction,
        smoothing=smoothing,
    )
    return Case(data, Truth(admissible=True))


@family
def large_friction(random: Random) -> Case:
    """mu from 1.5 to 8 on a clamped block."""
    dim = pick(random, [2, 2, 3])
    return _clamped(random, dim, between(random, 1.5, 8.0), some_kernel(random))


@family
def sliding_block(random: Random) -> Case:
    """A flat block whose top is pushed far along the foundation: all of it slips."""
    mesh = {
        "builder": "block",
        "dim": 2,
        "size": [2.0, 0.5],
        "h": 0.125,
        "structured": True,
    }
    push = {"on": "top", "value": [between(random, 0.05, 0.3), -0.01]}
    data = study(
        mesh,
        {"displacements": [push]},
        poisson=pick(random, [0.0, 0.2]),
        friction=pick(random, [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 5.0, 8.0]),
        smoothing={"kernel": "convolution", "radius": 0.2},
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def steep_slip(random: Random) -> Case:
    """mu that falls or rises within a small slip."""
    top, drop = pick(random, [0.3, 0.6]), pick(random, [0.1, 0.25, -0.4])
    length = decades(random, -5.0, -1.0)
    law = f"{top} - {drop}*s/(s + {length})"
    return _clamped(random, pick(random, [2, 2, 3]), law, some_kernel(random))


@family
def hardening_slip(random: Random) -> Case:
    """mu that rises with the slip, of a body that is clamped or that friction alone holds."""
    low, rise, length = (
        between(random, 0.05, 0.3),
        between(random, 0.1, 1.0),
        decades(random, -4, -1),
    )
    if chance(random):
        law = f"{low} + {rise}*min(s/{length}, 1)"
        return _clamped(random, pick(random, [2, 2, 3]), law, some_kernel(random))
    # Poisson's ratio is 0, so that pressure and shear stress are the same in all places below.
    share, pressure = between(random, 0.1, 0.9), 0.02
    push = (low + share * rise) * pressure
    mesh = unit_block(random, pick(random, [2, 2, 3]))
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
    law = pick(random, ["0.5*x", "0.6*(1 - x)", "0.8 if x < 0.47 else 0", "0.3 + 0.3*sin(6*x)"])
    dim = pick(random, [2, 3])
    return _clamped(random, dim, law, some_kernel(random))


@family
def local_coulomb_2d(random: Random) -> Case:
    """R is the identity."""
    return _clamped(random, 2, between(random, 0.1, 1.2), {"kernel": "none"}, fine=True)


@family
def local_coulomb_3d(random: Random) -> Case:
    """R is the identity, in space."""
    return _clamped(random, 3, between(random, 0.1, 1.0), {"kernel": "none"}, fine=True)


@family
def smoothing_radius(random: Random) -> Case:
    """Kernels from a quarter of an element to a thousand bodies wide."""
    kernel = pick(random, ["convolution", "helmholtz"])
    smoothing = {"kernel": kernel, "radius": decades(random, -1.3, 3.0)}
    return _clamped(random, pick(random, [2, 2, 3]), between(random, 0.1, 1.0), smoothing)


@family
def pushed_along(random: Random) -> Case:
    """A top that is pressed and pushed by prescribed displacements: stick and slip."""
    dim, limit = pick(random, [2, 2, 3]), pick(random, [math.inf, 0.05])
    size = 0.3 * strain_size(limit)
    value = downwards(random, dim, size)
    data = study(
        unit_block(random, dim),
        {"displacements": [{"on": "top", "value": value}]},
        limit=limit,
        friction=between(random, 0.1, 1.0),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(touches=True))
