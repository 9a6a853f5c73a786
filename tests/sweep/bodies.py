"""Bodies that touch each other: stacks, press fits, grains in a box and a grip."""

from __future__ import annotations

import math

from contact_locking.meshes.grains import Grains

from .case import (
    Case,
    Random,
    Study,
    Truth,
    between,
    chance,
    clamp,
    decades,
    downwards,
    family,
    pick,
    some_friction,
    some_kernel,
    some_limit,
    strain_size,
    study,
)


@family
def bodies(random: Random) -> Case:
    """Two blocks of different stiffness, or a ring on a disc, either side with the conditions."""
    return _stack(random) if chance(random, 0.7) else _fit(random)


def _stack(random: Random) -> Case:
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    mesh: Study = {
        "builder": "stack",
        "dim": dim,
        "h": pick(random, [0.3, 0.2]) if dim == 2 else 0.5,
        "slope": pick(random, [0.0, 0.0, 0.2]),
    }
    if chance(random, 0.4):
        mesh["upper"] = [between(random, 0.5, 1.4) for _ in range(dim)]
    sides = ["upper_bottom", "lower_top"]
    held = [clamp(dim, "bottom")]
    friction, loads = some_friction(random), Study()
    known: bool | None = True
    if chance(random):
        # The upper block is pushed down, and along if friction and the lower one let it.
        held.append({"on": "top", "value": downwards(random, dim, 0.3 * size)})
        known = None if math.isfinite(limit) else True
    else:
        held.append({"on": "upper_left", "value": [0.0, *[None] * (dim - 1)]})
        if dim == 3:
            held.append({"on": "upper_front", "value": [None, 0.0, None]})
        loads["tractions"] = [{"on": "top", "value": [0.0] * (dim - 1) + [-0.5 * size]}]
    loads["displacements"] = held
    data = study(
        mesh,
        loads,
        poisson=between(random, 0.0, 0.4),
        limit=limit,
        gap=pick(random, [0.0, 0.0, -0.1 * size, 0.05 * size]),
        friction=friction,
        smoothing=some_kernel(random, 0.6),
    )
    swapped = chance(random)
    data["contact"] |= {"on": sides[swapped], "against": sides[not swapped]}
    young = decades(random, -2.0, 2.0)
    other: Study = {"elasticity": {"young": young, "poisson": between(random, 0.0, 0.4)}}
    data["material"]["regions"] = {"lower": other}
    if chance(random, 0.3 if dim == 2 else 0.6):
        data["mesh"] |= {"cells": "box", "structured": dim == 3}
    return Case(data, Truth(admissible=known))


@family
def grains(random: Random) -> Case:
    """Discs between three walls, which a piston presses or their weight."""
    count, limit = int(random.integers(2, 9)), some_limit(random)
    size = strain_size(limit)
    mesh: Study = {
        "builder": "grains",
        "count": count,
        "spread": pick(random, [0.01, 0.1, 0.3]),
        "width": between(random, 2.7, 7.0),
        "distance": pick(random, [None, None, 0.1 * size]),
        "seed": int(random.integers(100)),
        "h": pick(random, [0.5, 0.4]),
    }
    kept = {key: value for key, value in mesh.items() if key not in ("builder", "h")}
    top = max(y + radius for _, y, radius in Grains(**kept, h=0.5).discs)
    push = pick(random, [0.0, between(random, 0.1, 2.0) * size])
    walls: list[Study] = [
        {"point": [0.0, 0.0], "normal": [0.0, 1.0]},
        {"point": [0.0, 0.0], "normal": [1.0, 0.0]},
        {"point": [mesh["width"], 0.0], "normal": [-1.0, 0.0]},
        {"point": [0.0, top - push], "normal": [0.0, -1.0]},
    ]
    loads: Study = {"springs": [{"on": "grains", "stiffness": pick(random, [1e-6, 1e-4])}]}
    if push == 0.0 or chance(random, 0.3):
        loads["body_force"] = [0.0, -between(random, 0.01, 0.1) * size]
    data = _rubbing(random, mesh, loads, limit)
    data["contact"] = [{"on": "grains", "against": "grains"}]
    data["contact"] += [{"on": "grains", "foundation": {"half_space": wall}} for wall in walls]
    return Case(data, Truth(admissible=True if push == 0.0 or math.isinf(limit) else None))


@family
def grip(random: Random) -> Case:
    """A disc between two fingers that close on it, with its weight."""
    limit = some_limit(random)
    size = strain_size(limit)
    mesh: Study = {
        "builder": "grip",
        "width": between(random, 0.4, 0.8),
        "length": between(random, 1.5, 2.5),
        "h": pick(random, [0.4, 0.3]),
    }
    inwards = between(random, 0.1, 2.0) * size
    loads: Study = {
        "displacements": [
            {"on": "left_root", "value": [inwards, 0.0]},
            {"on": "right_root", "value": [-inwards * pick(random, [1.0, 1.0, 0.5]), 0.0]},
        ],
        "springs": [{"on": "rim", "stiffness": pick(random, [1e-6, 1e-4])}],
    }
    if chance(random):
        loads["body_force"] = [0.0, -between(random, 0.001, 0.03) * size]
    data = _rubbing(random, mesh, loads, limit, 0.5)
    young, poisson = decades(random, -1.0, 1.0), between(random, 0.0, 0.4)
    data["material"]["regions"] = {
        side: {"elasticity": {"young": young, "poisson": poisson}} for side in ("left", "right")
    }
    pads = ["left_pad", "right_pad"]
    # A chord leaves out so much of the disc, which would be within the pads before their nodes.
    if chance(random) or mesh["h"] ** 2 / 8.0 > inwards:
        data["contact"] = {"on": "rim", "against": pads}
    elif chance(random):
        data["contact"] = {"on": pads, "against": "rim"}
    else:
        data["contact"] = [{"on": pad, "against": "rim"} for pad in pads]
        data["friction"]["smoothing"] = {"kernel": "none"}
    return Case(data, Truth(admissible=True if math.isinf(limit) else None))


def _fit(random: Random) -> Case:
    limit = math.inf if chance(random) else decades(random, -2.0, -1.0)
    overlap = pick(random, [1e-4, 1e-3, 0.01])
    mesh = {"builder": "disc_in_ring", "quarter": True, "hole": pick(random, [None, 0.4]), "h": 0.2}
    planes: list[Study] = [
        {"on": "left", "value": [0.0, None]},
        {"on": "bottom", "value": [None, 0.0]},
    ]
    data = study(
        mesh,
        {"displacements": planes},
        poisson=between(random, 0.0, 0.4),
        limit=limit,
        gap=-overlap,
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.3),
    )
    sides = ["rim", "inner"]
    swapped = chance(random)
    data["contact"] |= {"on": sides[swapped], "against": sides[not swapped]}
    other: Study = {"elasticity": {"young": decades(random, -2.0, 2.0), "poisson": 0.3}}
    data["material"]["regions"] = {"ring": other}
    return Case(data, Truth(admissible=True if math.isinf(limit) else None, touches=True))


def _rubbing(
    random: Random, mesh: Study, loads: Study, limit: float, radius: float | None = None
) -> Study:
    """Bodies with friction, whose bound is smoothed if there is a radius to draw from."""
    return study(
        mesh,
        loads,
        poisson=between(random, 0.0, 0.4),
        limit=limit,
        friction=some_friction(random),
        smoothing={"kernel": "none"} if radius is None else some_kernel(random, radius),
        penalty=pick(random, [{"n": math.inf}, {"n": math.inf}, {"n": 1e4}]),
    )
