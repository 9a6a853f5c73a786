"""Families of foundations and supports."""

from __future__ import annotations

import math
from typing import Any

from .case import (
    Case,
    Random,
    Study,
    Truth,
    between,
    chance,
    clamp,
    down,
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
    vector,
)


@family
def overlap(random: Random) -> Case:
    """A foundation that reaches into the body at the start."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    depth = strain_size(limit) * between(random, 0.02, 0.4)
    data = study(
        unit_block(random, dim),
        held_and_pressed(random, dim, strain_size(limit)),
        limit=limit,
        gap=pick(random, [-depth, f"{-depth}*x", f"{depth}*(1 - 2*x)"]),
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    # Held at the foot and pushed there at once: nothing is promised.
    return Case(data, Truth(admissible=None if math.isfinite(limit) else True))


@family
def tilted(random: Random) -> Case:
    """A tilted half-space that touches the edge of the body, or a little apart or inside."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    slopes = [size * x for x in vector(random, dim - 1, 2.0)]
    shift = size * pick(random, [0.0, 0.5, -0.2])
    space = {"half_space": {"point": down(dim, shift), "normal": [*slopes, 1.0]}}
    return _on(random, dim, limit, space)


@family
def curved_2d(random: Random) -> Case:
    """A disc below the body, apart or overlapping."""
    return _round(random, 2)


@family
def curved_3d(random: Random) -> Case:
    """A sphere or a cylinder below the body, apart or overlapping."""
    return _round(random, 3)


def _round(random: Random, dim: int) -> Case:
    limit, radius = some_limit(random), between(random, 0.3, 3.0)
    gap = strain_size(limit) * pick(random, [0.0, 0.3, -0.3])
    centre = [0.5] * (dim - 1) + [-radius - gap]
    body = {pick(random, ["sphere", "cylinder"]): {"centre": centre, "radius": radius}}
    return _on(random, dim, limit, body)


def _on(random: Random, dim: int, limit: float, foundation: Study) -> Case:
    size = strain_size(limit)
    if chance(random, 0.3):
        loads: Study = {"displacements": [{"on": "top", "value": downwards(random, dim, size)}]}
    else:
        loads = held_and_pressed(random, dim, 2.0 * size)
    data = study(
        unit_block(random, dim),
        loads,
        limit=limit,
        gap=foundation,
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth())


@family
def rollers(random: Random) -> Case:
    """Sides that slide freely; the foundation alone carries the load, with a gap or without."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    both = chance(random)
    free: list[Any] = [None] * (dim - 1)
    sides = [{"on": ["left", "right"] if both else "left", "value": [0.0, *free]}]
    if dim == 3:
        sides.append({"on": "front", "value": [None, 0.0, None]})
    pressure = size * between(random, 0.05, 1.0)
    loads = {"displacements": sides, "tractions": [{"on": "top", "value": down(dim, pressure)}]}
    data = study(
        unit_block(random, dim),
        loads,
        limit=limit,
        gap=pick(random, [0.0, 0.1, 1.0, size]),
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def held_by_friction(random: Random) -> Case:
    """A block that nothing clamps, pressed down and pulled along it by less than mu p."""
    mu, pressure = pick(random, [0.2, 0.5, 1.0]), 0.01 * between(random, 0.2, 1.0)
    pull = mu * pressure * between(random, 0.0, 0.6)
    width = pick(random, [1.0, 2.0])
    mesh = unit_block(random, 2) | {"size": [width, 1.0]}
    # The same shear on top and sides keeps the state of stress uniform.
    loads = {
        "tractions": [
            {"on": "top", "value": [pull, -pressure]},
            {"on": "right", "value": [0.0, pull]},
            {"on": "left", "value": [0.0, -pull]},
        ]
    }
    data = study(
        mesh,
        loads,
        limit=pick(random, [math.inf, 0.05]),
        friction=mu,
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def not_held_by_friction(random: Random) -> Case:
    """The same, pulled by more than mu p: friction cannot hold it."""
    mu, pressure = pick(random, [0.2, 0.5, 1.0]), 0.01 * between(random, 0.2, 1.0)
    pull = mu * pressure * between(random, 1.2, 3.0)
    loads = {
        "tractions": [
            {"on": "top", "value": [pull, -pressure]},
            {"on": "right", "value": [0.0, pull]},
            {"on": "left", "value": [0.0, -pull]},
        ]
    }
    data = study(unit_block(random, 2), loads, friction=mu, smoothing=some_kernel(random))
    return Case(data, Truth(admissible=True, refused="friction cannot hold"))


@family
def pinched(random: Random) -> Case:
    """A block between two walls that squeeze it, and no other support than their friction."""
    depth = 0.01 * between(random, 0.1, 1.0)
    weight = 0.2 * depth * between(random, 0.0, 0.5)
    data = study(
        unit_block(random, 2),
        {"body_force": [0.0, -weight]},
        limit=math.inf,
        gap=-depth,
        on=["left", "right"],
        friction=pick(random, [0.5, 1.0]),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def pressed_disc(random: Random) -> Case:
    """A half disc on a plane, guided at its flat top and carried by its lowest part alone."""
    mesh = {"builder": "disc", "contact_width": 0.8, "h": 0.25}
    plane = {"half_space": {"point": [0.0, pick(random, [0.0, -0.001])], "normal": [0.0, 1.0]}}
    loads: Study = {
        "tractions": [{"on": "top", "value": [0.0, -0.003 * between(random, 0.5, 2.0)]}],
        "displacements": [{"on": "top", "value": [0.0, None]}],
    }
    data = study(
        mesh,
        loads,
        limit=some_limit(random),
        gap=plane,
        on="contact",
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def pressed_corner(random: Random) -> Case:
    """A block pushed into a corner of two walls, which hold it with friction or without."""
    size = 0.01 * between(random, 0.2, 1.0)
    loads = {
        "tractions": [
            {"on": "top", "value": [0.0, -size]},
            {"on": "right", "value": [-size * between(random, 0.5, 1.5), 0.0]},
        ]
    }
    data = study(
        unit_block(random, 2),
        loads,
        limit=pick(random, [math.inf, 0.02]),
        gap=pick(random, [0.0, 1e-3]),
        on=["left", "bottom"],
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def prescribed(random: Random) -> Case:
    """A side moved by as much as some limits can follow; where not, that is what is right."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    on = pick(random, ["right", "top"])
    # The clamp on the left ends where the top begins.
    value = [f"{component}*x" for component in vector(random, dim, 0.6 * size)]
    loads = {"displacements": [clamp(dim), {"on": on, "value": value}]}
    data = study(
        unit_block(random, dim),
        loads,
        limit=limit,
        gap=size * pick(random, [0.0, 0.1, 1.0]),
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth())
