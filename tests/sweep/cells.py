"""Families of meshes of boxes, and of boundary parts that are named by their places."""

from __future__ import annotations

import math

from .case import (
    Case,
    Random,
    Study,
    Truth,
    between,
    chance,
    decades,
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
def boxes(random: Random) -> Case:
    """Boxes in a lattice or around an inclusion, sometimes heated."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    mesh: Study = {"builder": "block", "dim": dim, "size": [1.0] * dim, "structured": True}
    mesh["h"] = pick(random, [0.5, 0.34]) if dim == 3 else pick(random, [0.25, 0.15])
    core = dim == 2 and chance(random, 0.4)
    if core:
        mesh = {"builder": "inclusion", "dim": 2, "h": 0.15}
    elif dim == 2 and chance(random):
        mesh["structured"] = False
    data = study(
        mesh | {"cells": "box"},
        held_and_pressed(random, dim, size * between(random, 0.2, 2.0)),
        poisson=pick(random, [0.0, 0.3, 0.45]),
        limit=limit,
        gap=pick(random, [0.0, 0.1 * size]),
        friction=some_friction(random),
        smoothing=some_kernel(random),
        penalty=pick(random, [None, {"n": decades(random, 1.0, 4.0)}]),
    )
    if core:
        inner: Study = {"elasticity": {"young": decades(random, -2.0, 2.0), "poisson": 0.3}}
        data["material"]["regions"] = {"inclusion": inner}
    if chance(random, 0.4):
        data["material"]["eigenstrain"] = [{"value": vector(random, dim, size)}]
    if chance(random, 0.3):
        bed = {"on": "right", "stiffness": decades(random, -2.0, 1.0), "along": "normal"}
        data["loads"]["springs"] = [bed]
    return Case(data, Truth(admissible=True))


@family
def placed(random: Random) -> Case:
    """Contact, loads and displacements on parts by place: planes, boxes, conditions."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    mesh = unit_block(random, dim)
    end = between(random, 0.5, 1.0)
    up = [0.0] * (dim - 1) + [1.0]
    low, high = [-math.inf] * dim, [math.inf] * dim
    half = [end, *high[1:-1], 0.0]
    pads: list[Study] = [
        {"on": "bottom", "box": [low, [end, *high[1:]]]},
        {"plane": {"point": [0.0] * dim, "normal": up}, "expression": f"x < {end}"},
        {"box": [low, half]},
    ]
    mesh["parts"] = {
        "pad": pick(random, pads),
        "wall": {"plane": {"point": [0.0] * dim, "normal": [1.0, *[0.0] * (dim - 1)]}},
        "load": {"expression": f"{'xyz'[dim - 1]} > 0.99 and x > 0.3"},
    }
    loads = held_and_pressed(random, dim, size * between(random, 0.2, 2.0), "load")
    loads["displacements"][0]["on"] = "wall"
    data = study(
        mesh,
        loads,
        limit=limit,
        gap=pick(random, [0.0, 0.1 * size]),
        on="pad",
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True))
