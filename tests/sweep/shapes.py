"""Families of other bodies: of other shapes and cells, thin ones, and bodies that touch."""

from __future__ import annotations

import math

from contact_locking.meshes.grains import Grains

from .case import Case, Random, Study, Truth, clamp, down, family, strain_size, study


@family
def l_shape(random: Random) -> Case:
    """An L, clamped or pushed at its top and loaded on the foot."""
    dim, limit, size = random.body()
    mesh = {"builder": "l_shape", "dim": dim, "h": random.pick([0.1, 0.2]) if dim == 2 else 0.4}
    loads: Study = {
        "tractions": [{"on": "inner_horizontal", "value": random.vector(dim, size)}],
        "displacements": [clamp(dim, "top")],
    }
    known: bool | None = True
    if random.chance():
        loads["displacements"] = [{"on": "top", "value": random.downwards(dim, 0.3 * size)}]
        known = None
    data = random.rubbing(
        mesh,
        loads,
        poisson=random.between(0.0, 0.4),
        limit=limit,
        gap=random.pick([0.0, 0.1 * size]),
        radius=0.2,
    )
    return Case(data, Truth(admissible=known))


@family
def punch(random: Random) -> Case:
    """A flat or rounded punch pressed into half a block."""
    dim, limit = random.pick([2, 2, 3]), random.limit()
    depth = strain_size(limit) * random.between(0.05, 0.3)
    mesh = {"builder": "punch", "dim": dim, "h": 0.2 if dim == 2 else 0.35, "half_width": 0.4}
    planes: list[Study] = [
        clamp(dim, "bottom"),
        {"on": "symmetry", "value": [0.0, *[None] * (dim - 1)]},
    ]
    if dim == 3:
        planes.append({"on": "symmetry_y", "value": [None, 0.0, None]})
    data = random.rubbing(
        mesh,
        {"displacements": planes},
        limit=limit,
        gap=random.pick([-depth, f"{-depth} + {depth}*x**2/0.16"]),
        on="contact",
        radius=0.3,
    )
    return Case(data, Truth(admissible=True if math.isinf(limit) else None, touches=True))


@family
def disc(random: Random) -> Case:
    """A half disc pressed onto a plane, or a quarter of it."""
    limit = random.limit()
    size = strain_size(limit)
    quarter = random.chance(0.3)
    mesh: Study = {"builder": "disc", "h": 0.2, "contact_width": 0.5, "quarter": quarter}
    if random.chance():
        mesh["h_contact"] = 0.1
    plane = {"half_space": {"point": down(2, random.pick([0.0, 0.1 * size])), "normal": [0, 1]}}
    push = random.downwards(2, size)
    supports: list[Study] = [{"on": "top", "value": [None if quarter else push[0], push[1]]}]
    if quarter:
        supports.append({"on": "symmetry", "value": [0.0, None]})
    data = random.rubbing(
        mesh, {"displacements": supports}, limit=limit, gap=plane, on="contact", radius=0.2
    )
    return Case(data, Truth())


@family
def ball(random: Random) -> Case:
    """A half ball pressed onto a plane."""
    limit = random.limit()
    size = strain_size(limit)
    mesh: Study = {"builder": "ball", "h": 0.4, "contact_width": 0.5, "h_contact": 0.3}
    plane = {"half_space": {"point": [0.0, 0.0, 0.0], "normal": [0, 0, 1]}}
    data = random.rubbing(
        mesh,
        {"displacements": [{"on": "top", "value": random.downwards(3, size)}]},
        limit=limit,
        gap=plane,
        on="contact",
        radius=0.3,
    )
    return Case(data, Truth())


@family
def annulus(random: Random) -> Case:
    """A ring, pressed from outside onto a rigid core, or a quarter of it."""
    limit = random.limit()
    size = strain_size(limit)
    quarter = random.chance()
    mesh: Study = {"builder": "annulus", "h": 0.35, "quarter": quarter}
    loads: Study = {}
    if quarter:
        loads["displacements"] = [
            {"on": "bottom", "value": [None, 0.0]},
            {"on": "left", "value": [0.0, None]},
        ]
        loads["tractions"] = [{"on": "outer", "value": ["-0.5*x", "-0.5*y"]}]
        scale = size * random.between(0.2, 2.0)
        loads["tractions"][0]["value"] = [f"-{scale}*{axis}" for axis in "xy"]
    else:
        loads["displacements"] = [
            {"on": "outer", "value": [f"-{0.2 * size}*x", f"-{0.2 * size}*y"]}
        ]
    data = random.rubbing(
        mesh, loads, limit=limit, gap=random.pick([0.0, 0.1 * size]), on="inner", radius=0.5
    )
    return Case(data, Truth(admissible=True if quarter else None))


@family
def thin(random: Random) -> Case:
    """A strip or a plate of 20 to 200 thicknesses, bent onto a floor below it."""
    dim, thickness = random.pick([2, 2, 3]), random.decades(-2.0, 1.0)
    slender = random.pick([20, 50, 100, 200]) if dim == 2 else random.pick([20, 30])
    length, young = slender * thickness, random.decades(0.0, 11.0)
    size = [length, thickness] if dim == 2 else [length, 3.0 * thickness, thickness]
    # A cantilever under this pressure sinks by so many times the gap at its end.
    gap = thickness * random.decades(-2.0, 0.0)
    pressure = random.between(0.5, 5.0) * gap * young * thickness**3 / (1.5 * length**4)
    loads: Study = {"displacements": [clamp(dim)], random.pick(["body_force", "tractions"]): None}
    if "tractions" in loads:
        loads["tractions"] = [{"on": "top", "value": down(dim, pressure)}]
    else:
        loads["body_force"] = down(dim, pressure / thickness)
    if random.chance():
        loads["displacements"].append(clamp(dim, "right"))
    data = random.rubbing(
        {
            "builder": "block",
            "dim": dim,
            "size": size,
            "h": thickness * (random.pick([1.0, 0.5]) if slender < 100 and dim == 2 else 1.0),
            "structured": random.chance(),
        },
        loads,
        young=young,
        limit=random.pick([math.inf, math.inf, 0.01]),
        gap=random.pick([gap, 0.0, f"{gap}*x/{length}"]),
        radius=3.0 * thickness,
    )
    return Case(data, Truth(admissible=True))


@family
def edges(random: Random) -> Case:
    """Contact up to a clamped part, round a corner, or on the sides beside a reentrant corner."""
    dim, limit, size = random.body()
    kind = random.pick(["beside clamps", "round a corner", "reentrant"])
    friction, known = random.friction(), None
    depth = size * random.pick([0.0, 0.05, 0.2, -0.1])
    loads: Study = {"tractions": [{"on": "top", "value": random.vector(dim, size)}]}
    if kind == "beside clamps":
        mesh, on = random.unit_block(dim), "bottom"
        sides = random.pick([["left"], ["left", "right"], ["right"]])
        loads["displacements"] = [clamp(dim, sides)]
    elif kind == "round a corner":
        mesh, on = random.unit_block(dim), random.pick([["bottom", "right"], ["right"]])
        loads["tractions"] = [{"on": "top", "value": random.downwards(dim, size)}]
        loads["displacements"] = [clamp(dim)]
    else:
        mesh = {"builder": "l_shape", "dim": dim, "h": 0.2 if dim == 2 else 0.4}
        on = random.pick(["inner_horizontal", "inner_vertical"])
        loads = {"displacements": [clamp(dim, "top")], "body_force": random.vector(dim, size)}
    if math.isinf(limit) or depth <= 0.0:
        known = True
    data = study(
        mesh, loads, limit=limit, gap=-depth, on=on, friction=friction, smoothing=random.kernel(0.3)
    )
    return Case(data, Truth(admissible=known))


@family
def boxes(random: Random) -> Case:
    """Boxes in a lattice or around an inclusion, sometimes heated."""
    dim, limit, size = random.body()
    mesh: Study = {"builder": "block", "dim": dim, "size": [1.0] * dim, "structured": True}
    mesh["h"] = random.pick([0.5, 0.34]) if dim == 3 else random.pick([0.25, 0.15])
    core = dim == 2 and random.chance(0.4)
    if core:
        mesh = {"builder": "inclusion", "dim": 2, "h": 0.15}
    elif dim == 2 and random.chance():
        mesh["structured"] = False
    data = study(
        mesh | {"cells": "box"},
        random.held_and_pressed(dim, size * random.between(0.2, 2.0)),
        poisson=random.pick([0.0, 0.3, 0.45]),
        limit=limit,
        gap=random.pick([0.0, 0.1 * size]),
        friction=random.friction(),
        smoothing=random.kernel(),
        penalty=random.pick([None, {"n": random.decades(1.0, 4.0)}]),
    )
    if core:
        inner: Study = {"elasticity": {"young": random.decades(-2.0, 2.0), "poisson": 0.3}}
        data["material"]["regions"] = {"inclusion": inner}
    if random.chance(0.4):
        data["material"]["eigenstrain"] = [{"value": random.vector(dim, size)}]
    if random.chance(0.3):
        bed = {"on": "right", "stiffness": random.decades(-2.0, 1.0), "along": "normal"}
        data["loads"]["springs"] = [bed]
    return Case(data, Truth(admissible=True))


@family
def placed(random: Random) -> Case:
    """Contact, loads and displacements on parts by place: planes, boxes, conditions."""
    dim, limit, size = random.body()
    mesh = random.unit_block(dim)
    end = random.between(0.5, 1.0)
    up = [0.0] * (dim - 1) + [1.0]
    low, high = [-math.inf] * dim, [math.inf] * dim
    half = [end, *high[1:-1], 0.0]
    pads: list[Study] = [
        {"on": "bottom", "box": [low, [end, *high[1:]]]},
        {"plane": {"point": [0.0] * dim, "normal": up}, "expression": f"x < {end}"},
        {"box": [low, half]},
    ]
    mesh["parts"] = {
        "pad": random.pick(pads),
        "wall": {"plane": {"point": [0.0] * dim, "normal": [1.0, *[0.0] * (dim - 1)]}},
        "load": {"expression": f"{'xyz'[dim - 1]} > 0.99 and x > 0.3"},
    }
    loads = random.held_and_pressed(dim, size * random.between(0.2, 2.0), "load")
    loads["displacements"][0]["on"] = "wall"
    data = random.rubbing(mesh, loads, limit=limit, gap=random.pick([0.0, 0.1 * size]), on="pad")
    return Case(data, Truth(admissible=True))


@family
def bodies(random: Random) -> Case:
    """Two blocks of different stiffness, or a ring on a disc, either side with the conditions."""
    return _stack(random) if random.chance(0.7) else _fit(random)


def _stack(random: Random) -> Case:
    dim, limit, size = random.body()
    mesh: Study = {
        "builder": "stack",
        "dim": dim,
        "h": random.pick([0.3, 0.2]) if dim == 2 else 0.5,
        "slope": random.pick([0.0, 0.0, 0.2]),
    }
    if random.chance(0.4):
        mesh["upper"] = [random.between(0.5, 1.4) for _ in range(dim)]
    sides = ["upper_bottom", "lower_top"]
    held = [clamp(dim, "bottom")]
    friction, loads = random.friction(), Study()
    known: bool | None = True
    if random.chance():
        # The upper block is pushed down, and along if friction and the lower one let it.
        held.append({"on": "top", "value": random.downwards(dim, 0.3 * size)})
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
        poisson=random.between(0.0, 0.4),
        limit=limit,
        gap=random.pick([0.0, 0.0, -0.1 * size, 0.05 * size]),
        friction=friction,
        smoothing=random.kernel(0.6),
    )
    swapped = random.chance()
    data["contact"] |= {"on": sides[swapped], "against": sides[not swapped]}
    young = random.decades(-2.0, 2.0)
    other: Study = {"elasticity": {"young": young, "poisson": random.between(0.0, 0.4)}}
    data["material"]["regions"] = {"lower": other}
    if random.chance(0.3 if dim == 2 else 0.6):
        data["mesh"] |= {"cells": "box", "structured": dim == 3}
    return Case(data, Truth(admissible=known))


@family
def grains(random: Random) -> Case:
    """Discs between three walls, which a piston presses or their weight."""
    count, limit = int(random.integers(2, 9)), random.limit()
    size = strain_size(limit)
    mesh: Study = {
        "builder": "grains",
        "count": count,
        "spread": random.pick([0.01, 0.1, 0.3]),
        "width": random.between(2.7, 7.0),
        "distance": random.pick([None, None, 0.1 * size]),
        "seed": int(random.integers(100)),
        "h": random.pick([0.5, 0.4]),
    }
    kept = {key: value for key, value in mesh.items() if key not in ("builder", "h")}
    top = max(y + radius for _, y, radius in Grains(**kept, h=0.5).discs)
    push = random.pick([0.0, random.between(0.1, 2.0) * size])
    walls: list[Study] = [
        {"point": [0.0, 0.0], "normal": [0.0, 1.0]},
        {"point": [0.0, 0.0], "normal": [1.0, 0.0]},
        {"point": [mesh["width"], 0.0], "normal": [-1.0, 0.0]},
        {"point": [0.0, top - push], "normal": [0.0, -1.0]},
    ]
    loads: Study = {"springs": [{"on": "grains", "stiffness": random.pick([1e-6, 1e-4])}]}
    if push == 0.0 or random.chance(0.3):
        loads["body_force"] = [0.0, -random.between(0.01, 0.1) * size]
    data = _rubbing(random, mesh, loads, limit)
    data["contact"] = [{"on": "grains", "against": "grains"}]
    data["contact"] += [{"on": "grains", "foundation": {"half_space": wall}} for wall in walls]
    return Case(data, Truth(admissible=True if push == 0.0 or math.isinf(limit) else None))


@family
def grip(random: Random) -> Case:
    """A disc between two fingers that close on it, with its weight."""
    limit = random.limit()
    size = strain_size(limit)
    mesh: Study = {
        "builder": "grip",
        "width": random.between(0.4, 0.8),
        "length": random.between(1.5, 2.5),
        "h": random.pick([0.4, 0.3]),
    }
    inwards = random.between(0.1, 2.0) * size
    loads: Study = {
        "displacements": [
            {"on": "left_root", "value": [inwards, 0.0]},
            {"on": "right_root", "value": [-inwards * random.pick([1.0, 1.0, 0.5]), 0.0]},
        ],
        "springs": [{"on": "rim", "stiffness": random.pick([1e-6, 1e-4])}],
    }
    if random.chance():
        loads["body_force"] = [0.0, -random.between(0.001, 0.03) * size]
    data = _rubbing(random, mesh, loads, limit, 0.5)
    young, poisson = random.decades(-1.0, 1.0), random.between(0.0, 0.4)
    data["material"]["regions"] = {
        side: {"elasticity": {"young": young, "poisson": poisson}} for side in ("left", "right")
    }
    pads = ["left_pad", "right_pad"]
    # A chord leaves out so much of the disc, which would be within the pads before their nodes.
    if random.chance() or mesh["h"] ** 2 / 8.0 > inwards:
        data["contact"] = {"on": "rim", "against": pads}
    elif random.chance():
        data["contact"] = {"on": pads, "against": "rim"}
    else:
        data["contact"] = [{"on": pad, "against": "rim"} for pad in pads]
        data["friction"]["smoothing"] = {"kernel": "none"}
    return Case(data, Truth(admissible=True if math.isinf(limit) else None))


def _fit(random: Random) -> Case:
    limit = math.inf if random.chance() else random.decades(-2.0, -1.0)
    overlap = random.pick([1e-4, 1e-3, 0.01])
    mesh = {"builder": "disc_in_ring", "quarter": True, "hole": random.pick([None, 0.4]), "h": 0.2}
    planes: list[Study] = [
        {"on": "left", "value": [0.0, None]},
        {"on": "bottom", "value": [None, 0.0]},
    ]
    data = random.rubbing(
        mesh,
        {"displacements": planes},
        poisson=random.between(0.0, 0.4),
        limit=limit,
        gap=-overlap,
        radius=0.3,
    )
    sides = ["rim", "inner"]
    swapped = random.chance()
    data["contact"] |= {"on": sides[swapped], "against": sides[not swapped]}
    other: Study = {"elasticity": {"young": random.decades(-2.0, 2.0), "poisson": 0.3}}
    data["material"]["regions"] = {"ring": other}
    return Case(data, Truth(admissible=True if math.isinf(limit) else None, touches=True))


def _rubbing(
    random: Random, mesh: Study, loads: Study, limit: float, radius: float | None = None
) -> Study:
    """Bodies with friction, whose bound is smoothed if there is a radius to draw from."""
    return study(
        mesh,
        loads,
        poisson=random.between(0.0, 0.4),
        limit=limit,
        friction=random.friction(),
        smoothing={"kernel": "none"} if radius is None else random.kernel(radius),
        penalty=random.pick([{"n": math.inf}, {"n": math.inf}, {"n": 1e4}]),
    )
