"""Families of foundations and supports, also of what contact or friction alone holds."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .case import Case, Random, Study, Truth, clamp, down, family, strain_size, study


@family
def overlap(random: Random) -> Case:
    """A foundation that reaches into the body at the start."""
    dim, limit = random.pick([2, 2, 3]), random.limit()
    depth = strain_size(limit) * random.between(0.02, 0.4)
    data = random.rubbing(
        random.unit_block(dim),
        random.held_and_pressed(dim, strain_size(limit)),
        limit=limit,
        gap=random.pick([-depth, f"{-depth}*x", f"{depth}*(1 - 2*x)"]),
    )
    # Held at the foot and pushed there at once: nothing is promised.
    return Case(data, Truth(admissible=None if math.isfinite(limit) else True))


@family
def tilted(random: Random) -> Case:
    """A tilted half-space that touches the edge of the body, or a little apart or inside."""
    dim, limit, size = random.body()
    slopes = [size * x for x in random.vector(dim - 1, 2.0)]
    shift = size * random.pick([0.0, 0.5, -0.2])
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
    limit, radius = random.limit(), random.between(0.3, 3.0)
    gap = strain_size(limit) * random.pick([0.0, 0.3, -0.3])
    centre = [0.5] * (dim - 1) + [-radius - gap]
    body = {random.pick(["sphere", "cylinder"]): {"centre": centre, "radius": radius}}
    return _on(random, dim, limit, body)


def _on(random: Random, dim: int, limit: float, foundation: Study) -> Case:
    size = strain_size(limit)
    if random.chance(0.3):
        loads: Study = {"displacements": [{"on": "top", "value": random.downwards(dim, size)}]}
    else:
        loads = random.held_and_pressed(dim, 2.0 * size)
    data = random.rubbing(random.unit_block(dim), loads, limit=limit, gap=foundation)
    return Case(data, Truth())


@family
def rollers(random: Random) -> Case:
    """Sides that slide freely; the foundation alone carries the load, with a gap or without."""
    dim, limit, size = random.body()
    both = random.chance()
    free: list[Any] = [None] * (dim - 1)
    sides = [{"on": ["left", "right"] if both else "left", "value": [0.0, *free]}]
    if dim == 3:
        sides.append({"on": "front", "value": [None, 0.0, None]})
    pressure = size * random.between(0.05, 1.0)
    loads = {"displacements": sides, "tractions": [{"on": "top", "value": down(dim, pressure)}]}
    data = random.rubbing(
        random.unit_block(dim), loads, limit=limit, gap=random.pick([0.0, 0.1, 1.0, size])
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def held_by_friction(random: Random) -> Case:
    """A block that nothing clamps, pressed down and pulled along it by less than mu p."""
    mu, pressure = random.pick([0.2, 0.5, 1.0]), 0.01 * random.between(0.2, 1.0)
    pull = mu * pressure * random.between(0.0, 0.6)
    width = random.pick([1.0, 2.0])
    mesh = random.unit_block(2) | {"size": [width, 1.0]}
    # The same shear on top and sides keeps the state of stress uniform.
    loads = {
        "tractions": [
            {"on": "top", "value": [pull, -pressure]},
            {"on": "right", "value": [0.0, pull]},
            {"on": "left", "value": [0.0, -pull]},
        ]
    }
    data = study(
        mesh, loads, limit=random.pick([math.inf, 0.05]), friction=mu, smoothing=random.kernel()
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def not_held_by_friction(random: Random) -> Case:
    """The same, pulled by more than mu p: friction cannot hold it."""
    mu, pressure = random.pick([0.2, 0.5, 1.0]), 0.01 * random.between(0.2, 1.0)
    pull = mu * pressure * random.between(1.2, 3.0)
    loads = {
        "tractions": [
            {"on": "top", "value": [pull, -pressure]},
            {"on": "right", "value": [0.0, pull]},
            {"on": "left", "value": [0.0, -pull]},
        ]
    }
    data = study(random.unit_block(2), loads, friction=mu, smoothing=random.kernel())
    return Case(data, Truth(admissible=True, refused="friction cannot hold"))


@family
def pinched(random: Random) -> Case:
    """A block between two walls that squeeze it, and no other support than their friction."""
    depth = 0.01 * random.between(0.1, 1.0)
    weight = 0.2 * depth * random.between(0.0, 0.5)
    data = study(
        random.unit_block(2),
        {"body_force": [0.0, -weight]},
        limit=math.inf,
        gap=-depth,
        on=["left", "right"],
        friction=random.pick([0.5, 1.0]),
        smoothing=random.kernel(),
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def pressed_disc(random: Random) -> Case:
    """A half disc on a plane, guided at its flat top and carried by its lowest part alone."""
    mesh = {"builder": "disc", "contact_width": 0.8, "h": 0.25}
    plane = {"half_space": {"point": [0.0, random.pick([0.0, -0.001])], "normal": [0.0, 1.0]}}
    loads: Study = {
        "tractions": [{"on": "top", "value": [0.0, -0.003 * random.between(0.5, 2.0)]}],
        "displacements": [{"on": "top", "value": [0.0, None]}],
    }
    data = random.rubbing(mesh, loads, limit=random.limit(), gap=plane, on="contact")
    return Case(data, Truth(admissible=True, touches=True))


@family
def pressed_corner(random: Random) -> Case:
    """A block pushed into a corner of two walls, which hold it with friction or without."""
    size = 0.01 * random.between(0.2, 1.0)
    loads = {
        "tractions": [
            {"on": "top", "value": [0.0, -size]},
            {"on": "right", "value": [-size * random.between(0.5, 1.5), 0.0]},
        ]
    }
    data = random.rubbing(
        random.unit_block(2),
        loads,
        limit=random.pick([math.inf, 0.02]),
        gap=random.pick([0.0, 1e-3]),
        on=["left", "bottom"],
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def prescribed(random: Random) -> Case:
    """A side moved by as much as some limits can follow; where not, that is what is right."""
    dim, limit, size = random.body()
    on = random.pick(["right", "top"])
    # The clamp on the left ends where the top begins.
    value = [f"{component}*x" for component in random.vector(dim, 0.6 * size)]
    loads = {"displacements": [clamp(dim), {"on": on, "value": value}]}
    data = random.rubbing(
        random.unit_block(dim), loads, limit=limit, gap=size * random.pick([0.0, 0.1, 1.0])
    )
    return Case(data, Truth())


@family
def play(random: Random) -> Case:
    """A block on rollers between two foundations: pinched, pressed onto one of them, or loose.

    Loose, it may be moved by as much as the gaps leave; otherwise no other displacement solves the
    problem.  A tool above a clamped block may travel if no force pushes it.
    """
    if random.chance(0.25):
        return _tool(random)
    dim = random.pick([2, 2, 3])
    size, kind = random.decades(-5.0, -2.0), random.pick(["loose", "pressed", "pinched"])
    free: list[Any] = [None] * (dim - 1)
    sides: list[Study] = [{"on": "left", "value": [0.0, *free]}]
    if dim == 3:
        sides.append({"on": "front", "value": [None, 0.0, None]})
    if random.chance(0.7):
        # The height grows by less than the gaps.
        sides.append({"on": "right", "value": [-size * random.between(0.1, 1.0), *free]})
    loads: Study = {"displacements": sides}
    if kind == "pressed":
        loads["tractions"] = [{"on": "top", "value": down(dim, size * random.between(0.1, 1.0))}]
    gap = -size if kind == "pinched" else size * random.between(1.0, 20.0)
    slope = random.between(0.0, 0.5) * abs(gap)
    data = study(
        random.unit_block(dim),
        loads,
        limit=random.pick([math.inf, 5.0 * size]),
        gap=random.pick([gap, f"{gap} + {slope}*x"]),
        on=["bottom", "top"],
        penalty=random.pick([None, {"n": 1e4}]),
    )
    if kind != "loose":
        return Case(data, Truth(unique=True, touches=True))
    up = (*[0.0] * (dim - 1), 0.2 * gap)
    return Case(data, Truth(admissible=True, unique=False, other=up))


def _tool(random: Random) -> Case:
    """A clamped block below a tool whose force is zero at the last time, or is not."""
    size, pushes = random.decades(-5.0, -2.0), random.chance()
    height = 1.0 + random.pick([0.0, 0.1, 2.0]) * size
    last = "t" if pushes else "max(1 - t, 0)"
    space = {"point": [0.0, height], "normal": [0.0, -1.0]}
    data = study(
        random.unit_block(2),
        {"displacements": [{"on": "bottom", "value": [0.0, 0.0]}]},
        gap={"half_space": space, "force": [0.0, f"-{size}*{last}"]},
        on="top",
    )
    data["steps"] = {"times": [0.5, 1.0]}
    return Case(data, Truth(unique=pushes))


@family
def hardening(random: Random) -> Case:
    """Friction that grows with the slip and alone holds a block: the slip is known exactly.

    Without Poisson's effect the block is in uniform compression, and its foot slips until mu times
    the pressure is the shear.  Below mu(0) times the pressure it sticks.
    """
    dim, pressure = random.pick([2, 2, 3]), random.decades(-5.0, -2.0)
    least, more = random.between(0.0, 0.5), random.between(0.05, 1.0)
    length = float(f"{pressure * random.decades(-2.0, 1.0):.4g}")
    share = random.pick([-1.0, 1.0, 1.0, 1.0]) * random.between(0.05, 0.7)
    law, slip = {
        "line": (f"min(s/{length}, 1)", share * length),
        "hyperbola": (f"s/(s + {length})", length * share / (1.0 - share)),
        "exponential": (f"(1 - exp(-s/{length}))", -length * math.log(1.0 - share)),
    }[random.pick(["line", "hyperbola", "exponential"])]
    # A negative share is one of mu(0): the foot sticks.
    needed = least * (1.0 + share) if share < 0.0 else least + more * share
    angle = random.between(0.0, 6.28)
    along = [math.copysign(1.0, math.sin(angle))]
    if dim == 3:
        along = [math.cos(angle), math.sin(angle)]
    shear = [needed * pressure * x for x in along]
    loads = {
        "tractions": [
            {"on": "top", "value": down(dim, pressure)},
            {"on": "bottom", "value": [*shear, 0.0]},
        ]
    }
    data = study(
        random.unit_block(dim),
        loads,
        poisson=0.0,
        friction=f"{least} + {more}*{law}",
        smoothing={"kernel": random.pick(["convolution", "helmholtz"]), "radius": 0.6},
    )
    foot = tuple(max(slip, 0.0) * np.array(along))
    return Case(data, Truth(admissible=True, touches=True, slip=foot))


@family
def lifted(random: Random) -> Case:
    """A thin strip on a floor, lifted at one end, which friction or a roller holds along the floor.

    The strip is heavier than what lifts it, so that a part of the strip stays on the floor.
    """
    thickness, young = random.decades(-3.0, 2.0), random.decades(0.0, 11.0)
    slenderness = random.pick([10, 20, 40, 80])
    length, weight = slenderness * thickness, young * random.decades(-9.0, -5.0) / slenderness
    # A beam of this stiffness is lifted over the share s of its length by the height h.
    share = random.between(0.3, 0.8)
    height = weight * thickness * (share * length) ** 4 / (2.0 * young * thickness**3)
    lift = {"on": "right", "value": [None, height]}
    roller = {"on": "left", "value": [0.0, None]}
    by_friction = random.chance(0.7)
    data = study(
        {
            "builder": "block",
            "dim": 2,
            "size": [length, thickness],
            "h": thickness,
            "structured": True,
        },
        {"body_force": [0.0, -weight], "displacements": [lift] if by_friction else [lift, roller]},
        young=young,
        friction=random.between(0.05, 0.8) if by_friction else 0.0,
        smoothing={"kernel": random.pick(["none", "convolution"]), "radius": 3.0 * thickness},
    )
    return Case(data, Truth(admissible=True, touches=True))


@family
def sticky(random: Random) -> Case:
    """A block under a plate that is pressed on a floor with a coefficient up to a million."""
    width, press = random.between(1.0, 4.0), random.between(0.002, 0.05)
    data = study(
        {
            "builder": "block",
            "dim": 2,
            "size": [width, 1.0],
            "h": random.pick([0.25, 0.2]),
            "structured": random.chance(),
        },
        {"displacements": [{"on": "top", "value": [0.0, -press]}]},
        poisson=random.pick([0.0, 0.3, 0.45, 0.49]),
        friction=random.decades(1.0, 6.0),
        smoothing={"kernel": random.pick(["none", "convolution", "helmholtz"]), "radius": 0.5},
    )
    return Case(data, Truth(admissible=True, touches=True))
