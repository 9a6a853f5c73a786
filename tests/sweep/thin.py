"""Families of thin bodies, and of contact up to clamped parts, edges and corners."""

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
    decades,
    down,
    downwards,
    family,
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
def thin(random: Random) -> Case:
    """A strip or a plate of 20 to 200 thicknesses, bent onto a floor below it."""
    dim, thickness = pick(random, [2, 2, 3]), decades(random, -2.0, 1.0)
    slender = pick(random, [20, 50, 100, 200]) if dim == 2 else pick(random, [20, 30])
    length, young = slender * thickness, decades(random, 0.0, 11.0)
    size = [length, thickness] if dim == 2 else [length, 3.0 * thickness, thickness]
    # A cantilever under this pressure sinks by so many times the gap at its end.
    gap = thickness * decades(random, -2.0, 0.0)
    pressure = between(random, 0.5, 5.0) * gap * young * thickness**3 / (1.5 * length**4)
    loads: Study = {
        "displacements": [clamp(dim)],
        pick(random, ["body_force", "tractions"]): None,
    }
    if "tractions" in loads:
        loads["tractions"] = [{"on": "top", "value": down(dim, pressure)}]
    else:
        loads["body_force"] = down(dim, pressure / thickness)
    if chance(random):
        loads["displacements"].append(clamp(dim, "right"))
    data = study(
        {
            "builder": "block",
            "dim": dim,
            "size": size,
            "h": thickness * (pick(random, [1.0, 0.5]) if slender < 100 and dim == 2 else 1.0),
            "structured": chance(random),
        },
        loads,
        young=young,
        limit=pick(random, [math.inf, math.inf, 0.01]),
        gap=pick(random, [gap, 0.0, f"{gap}*x/{length}"]),
        friction=some_friction(random),
        smoothing=some_kernel(random, 3.0 * thickness),
    )
    return Case(data, Truth(admissible=True))


@family
def edges(random: Random) -> Case:
    """Contact up to a clamped part, round a corner, or on the sides beside a reentrant corner."""
    dim, limit = pick(random, [2, 2, 3]), some_limit(random)
    size = strain_size(limit)
    kind = pick(random, ["beside clamps", "round a corner", "reentrant"])
    friction, known = some_friction(random), None
    depth = size * pick(random, [0.0, 0.05, 0.2, -0.1])
    loads: Study = {"tractions": [{"on": "top", "value": vector(random, dim, size)}]}
    if kind == "beside clamps":
        mesh, on = unit_block(random, dim), "bottom"
        sides = pick(random, [["left"], ["left", "right"], ["right"]])
        loads["displacements"] = [clamp(dim, sides)]
    elif kind == "round a corner":
        mesh, on = unit_block(random, dim), pick(random, [["bottom", "right"], ["right"]])
        loads["tractions"] = [{"on": "top", "value": downwards(random, dim, size)}]
        loads["displacements"] = [clamp(dim)]
    else:
        mesh = {"builder": "l_shape", "dim": dim, "h": 0.2 if dim == 2 else 0.4}
        on = pick(random, ["inner_horizontal", "inner_vertical"])
        loads = {
            "displacements": [clamp(dim, "top")],
            "body_force": vector(random, dim, size),
        }
    if math.isinf(limit) or depth <= 0.0:
        known = True
    data = study(
        mesh,
        loads,
        limit=limit,
        gap=-depth,
        on=on,
        friction=friction,
        smoothing=some_kernel(random, 0.3),
    )
    return Case(data, Truth(admissible=known))
