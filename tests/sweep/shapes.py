"""Families of bodies other than the block."""

from __future__ import annotations

import math

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
    pick,
    some_friction,
    some_kernel,
    some_limit,
    strain_size,
    study,
    vector,
)


@family
def l_shape(random: Random) -> Case:
    """An L, clamped or pushed at its top and loaded on the foot."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    mesh = {"builder": "l_shape", "dim": dim, "h": pick(random, [0.1, 0.2]) if dim == 2 else 0.4}
    loads: Study = {
        "tractions": [{"on": "inner_horizontal", "value": vector(random, dim, size)}],
        "displacements": [clamp(dim, "top")],
    }
    known: bool | None = True
    if chance(random):
        loads["displacements"] = [{"on": "top", "value": downwards(random, dim, 0.3 * size)}]
        known = None
    data = study(
        mesh,
        loads,
        poisson=between(random, 0.0, 0.4),
        limit=limit,
        gap=pick(random, [0.0, 0.1 * size]),
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.2),
    )
    return Case(data, Truth(admissible=known))


@family
def punch(random: Random) -> Case:
    """A flat or rounded punch pressed into half a block."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    depth = strain_size(limit) * between(random, 0.05, 0.3)
    mesh = {"builder": "punch", "dim": dim, "h": 0.2 if dim == 2 else 0.35, "half_width": 0.4}
    planes: list[Study] = [
        clamp(dim, "bottom"),
        {"on": "symmetry", "value": [0.0, *[None] * (dim - 1)]},
    ]
    if dim == 3:
        planes.append({"on": "symmetry_y", "value": [None, 0.0, None]})
    data = study(
        mesh,
        {"displacements": planes},
        limit=limit,
        gap=pick(random, [-depth, f"{-depth} + {depth}*x**2/0.16"]),
        on="contact",
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.3),
    )
    return Case(data, Truth(admissible=True if math.isinf(limit) else None, touches=True))


@family
def disc(random: Random) -> Case:
    """A half disc pressed onto a plane, or a quarter of it."""
    limit = some_limit(random)
    size = strain_size(limit)
    quarter = chance(random, 0.3)
    mesh: Study = {"builder": "disc", "h": 0.2, "contact_width": 0.5, "quarter": quarter}
    if chance(random):
        mesh["h_contact"] = 0.1
    plane = {"half_space": {"point": down(2, pick(random, [0.0, 0.1 * size])), "normal": [0, 1]}}
    push = downwards(random, 2, size)
    supports: list[Study] = [{"on": "top", "value": [None if quarter else push[0], push[1]]}]
    if quarter:
        supports.append({"on": "symmetry", "value": [0.0, None]})
    data = study(
        mesh,
        {"displacements": supports},
        limit=limit,
        gap=plane,
        on="contact",
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.2),
    )
    return Case(data, Truth())


@family
def ball(random: Random) -> Case:
    """A half ball pressed onto a plane."""
    limit = some_limit(random)
    size = strain_size(limit)
    mesh: Study = {"builder": "ball", "h": 0.4, "contact_width": 0.5, "h_contact": 0.3}
    plane = {"half_space": {"point": [0.0, 0.0, 0.0], "normal": [0, 0, 1]}}
    data = study(
        mesh,
        {"displacements": [{"on": "top", "value": downwards(random, 3, size)}]},
        limit=limit,
        gap=plane,
        on="contact",
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.3),
    )
    return Case(data, Truth())


@family
def annulus(random: Random) -> Case:
    """A ring, pressed from outside onto a rigid core, or a quarter of it."""
    limit = some_limit(random)
    size = strain_size(limit)
    quarter = chance(random)
    mesh: Study = {"builder": "annulus", "h": 0.35, "quarter": quarter}
    loads: Study = {}
    if quarter:
        loads["displacements"] = [
            {"on": "bottom", "value": [None, 0.0]},
            {"on": "left", "value": [0.0, None]},
        ]
        loads["tractions"] = [{"on": "outer", "value": ["-0.5*x", "-0.5*y"]}]
        scale = size * between(random, 0.2, 2.0)
        loads["tractions"][0]["value"] = [f"-{scale}*{axis}" for axis in "xy"]
    else:
        loads["displacements"] = [
            {"on": "outer", "value": [f"-{0.2 * size}*x", f"-{0.2 * size}*y"]}
        ]
    data = study(
        mesh,
        loads,
        limit=limit,
        gap=pick(random, [0.0, 0.1 * size]),
        on="inner",
        friction=some_friction(random),
        smoothing=some_kernel(random, 0.5),
    )
    return Case(data, Truth(admissible=True if quarter else None))
