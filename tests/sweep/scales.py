"""Families of units and sizes: the answer must not know in which unit it is asked for."""

from __future__ import annotations

import math

from .case import (
    Case,
    Random,
    Truth,
    between,
    chance,
    clamp,
    decades,
    downwards,
    family,
    held_and_pressed,
    pick,
    some_friction,
    some_kernel,
    some_limit,
    strain_size,
    study,
    unit_block,
)


@family
def block_2d(random: Random) -> Case:
    """A unit square, clamped and pressed: u = 0 is admissible."""
    return _block(random, 2)


@family
def block_3d(random: Random) -> Case:
    """A unit cube, clamped and pressed: u = 0 is admissible."""
    return _block(random, 3)


def _block(random: Random, dim: int, young: float = 1.0) -> Case:
    limit = some_limit(random)
    size = strain_size(limit)
    data = study(
        unit_block(random, dim),
        held_and_pressed(random, dim, young * size * between(random, 0.2, 3.0)),
        young=young,
        poisson=between(random, 0.0, 0.45),
        limit=limit,
        gap=pick(random, [0.0, 0.1 * size, f"{size}*(0.2 + 0.3*x)"]),
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True))


@family
def stress_units(random: Random) -> Case:
    """Young's modulus and loads times 1e-12 to 1e12."""
    return _block(random, pick(random, [2, 2, 3]), decades(random, -12.0, 12.0))


@family
def length_units(random: Random) -> Case:
    """All lengths times 1e-9 to 1e9; body forces, which are none here, would be divided."""
    dim, unit = pick(random, [2, 2, 3]), decades(random, -9.0, 9.0)
    limit = some_limit(random)
    size = strain_size(limit)
    mesh = unit_block(random, dim)
    mesh |= {"size": [unit] * dim, "h": mesh["h"] * unit}
    pressure = size * between(random, 0.2, 3.0)
    loads = {
        "tractions": [{"on": "top", "value": downwards(random, dim, pressure)}],
        "displacements": [clamp(dim)],
    }
    data = study(
        mesh,
        loads,
        limit=limit,
        gap=pick(random, [0.0, 0.1 * size * unit]),
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.3 * unit),
    )
    return Case(data, Truth(admissible=True))


@family
def si_defaults(random: Random) -> Case:
    """Steel, rubber and others in pascals and metres; nothing is said of penalties."""
    young, poisson = pick(random, [(2.1e11, 0.3), (1e6, 0.49), (7e10, 0.33), (3e10, 0.2)])
    width = decades(random, -3.0, 1.0)
    mesh = unit_block(random, 2)
    mesh |= {"size": [2.0 * width, width], "h": mesh["h"] * width}
    moves = chance(random)
    displacements = [clamp(2)]
    loads = {"displacements": displacements}
    if moves:
        push = width * 1e-3 * between(random, 0.1, 5.0)
        displacements[0] = {"on": "top", "value": [pick(random, [0.0, push]), -push]}
    else:
        pressure = young * 1e-3 * between(random, 0.01, 1.0)
        loads["tractions"] = [{"on": "top", "value": [0.0, -pressure]}]
    data = study(
        mesh,
        loads,
        young=young,
        poisson=poisson,
        limit=pick(random, [math.inf, 0.1]),
        friction=some_friction(random),
        smoothing={"radius": 0.5 * width},
        penalty={},
    )
    return Case(data, Truth(admissible=None if moves else True, touches=True))


@family
def tiny_load(random: Random) -> Case:
    """Loads times 1e-30 to 1 without limit, gap and slip dependence: u scales with them."""
    dim, size = pick(random, [2, 2, 3]), decades(random, -30.0, 0.0)
    data = study(
        unit_block(random, dim),
        held_and_pressed(random, dim, size),
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True, homogeneous=True))
