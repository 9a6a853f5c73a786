"""Families of the unit block: units and sizes of loads, and little or nothing to do."""

from __future__ import annotations

import math
from typing import Any

from .case import USUAL_STRAIN, Case, Random, Study, Truth, clamp, down, family, strain_size, study


@family
def block_2d(random: Random) -> Case:
    """A unit square, clamped and pressed: u = 0 is admissible."""
    return _block(random, 2)


@family
def block_3d(random: Random) -> Case:
    """A unit cube, clamped and pressed: u = 0 is admissible."""
    return _block(random, 3)


def _block(random: Random, dim: int, young: float = 1.0) -> Case:
    limit = random.limit()
    size = strain_size(limit)
    data = random.rubbing(
        random.unit_block(dim),
        random.held_and_pressed(dim, young * size * random.between(0.2, 3.0)),
        young=young,
        poisson=random.between(0.0, 0.45),
        limit=limit,
        gap=random.pick([0.0, 0.1 * size, f"{size}*(0.2 + 0.3*x)"]),
    )
    return Case(data, Truth(admissible=True))


@family
def stress_units(random: Random) -> Case:
    """Young's modulus and loads times 1e-12 to 1e12."""
    return _block(random, random.pick([2, 2, 3]), random.decades(-12.0, 12.0))


@family
def length_units(random: Random) -> Case:
    """All lengths times 1e-9 to 1e9; body forces, which are none here, would be divided."""
    dim, unit = random.pick([2, 2, 3]), random.decades(-9.0, 9.0)
    limit = random.limit()
    size = strain_size(limit)
    mesh = random.unit_block(dim)
    mesh |= {"size": [unit] * dim, "h": mesh["h"] * unit}
    pressure = size * random.between(0.2, 3.0)
    loads = {
        "tractions": [{"on": "top", "value": random.downwards(dim, pressure)}],
        "displacements": [clamp(dim)],
    }
    data = random.rubbing(
        mesh, loads, limit=limit, gap=random.pick([0.0, 0.1 * size * unit]), radius=0.3 * unit
    )
    return Case(data, Truth(admissible=True))


@family
def si_defaults(random: Random) -> Case:
    """Steel, rubber and others in pascals and metres; nothing is said of penalties."""
    young, poisson = random.pick([(2.1e11, 0.3), (1e6, 0.49), (7e10, 0.33), (3e10, 0.2)])
    width = random.decades(-3.0, 1.0)
    mesh = random.unit_block(2)
    mesh |= {"size": [2.0 * width, width], "h": mesh["h"] * width}
    moves = random.chance()
    displacements = [clamp(2)]
    loads = {"displacements": displacements}
    if moves:
        push = width * 1e-3 * random.between(0.1, 5.0)
        displacements[0] = {"on": "top", "value": [random.pick([0.0, push]), -push]}
    else:
        pressure = young * 1e-3 * random.between(0.01, 1.0)
        loads["tractions"] = [{"on": "top", "value": [0.0, -pressure]}]
    data = study(
        mesh,
        loads,
        young=young,
        poisson=poisson,
        limit=random.pick([math.inf, 0.1]),
        friction=random.friction(),
        smoothing={"radius": 0.5 * width},
        penalty={},
    )
    return Case(data, Truth(admissible=None if moves else True, touches=True))


@family
def tiny_load(random: Random) -> Case:
    """Loads times 1e-30 to 1 without limit, gap and slip dependence: u scales with them."""
    dim, size = random.pick([2, 2, 3]), random.decades(-30.0, 0.0)
    data = random.rubbing(random.unit_block(dim), random.held_and_pressed(dim, size))
    return Case(data, Truth(admissible=True, homogeneous=True))


def _limit(random: Random) -> float:
    return random.pick([math.inf, 0.02, 1e-3])


def _moved(random: Random, mesh: Study, value: list[Any], **more: Any) -> Study:
    displacements = [{"on": "top", "value": value}]
    return study(
        mesh,
        {"displacements": displacements},
        limit=_limit(random),
        friction=random.friction(),
        smoothing=random.kernel(),
        **more,
    )


@family
def zero_load(random: Random) -> Case:
    """No load at all: u = 0 and nothing presses."""
    dim = random.pick([2, 2, 3])
    loads: Study = {"displacements": [clamp(dim, random.pick(["left", "top"]))]}
    if random.chance():
        loads["tractions"] = [{"on": "right", "value": [0.0] * dim}]
    data = random.rubbing(
        random.unit_block(dim), loads, limit=_limit(random), gap=random.pick([0.0, 0.01])
    )
    return Case(data, Truth(admissible=True, touches=False, translation=(0.0,) * dim))


@family
def approach(random: Random) -> Case:
    """The top is moved towards a foundation that is farther away: a translation."""
    dim = random.pick([2, 2, 3])
    gap = random.decades(-4.0, 0.0)
    *along, _ = random.vector(dim, 0.3 * gap)
    value = [*along, -gap * random.between(0.0, 0.9)]
    data = _moved(random, random.unit_block(dim), value, gap=gap)
    return Case(data, Truth(admissible=True, touches=False, translation=tuple(value)))


@family
def approach_curved(random: Random) -> Case:
    """The same towards a sphere or a cylinder below the body."""
    dim = random.pick([2, 2, 3])
    radius, gap = random.between(0.3, 3.0), random.decades(-4.0, -1.0)
    centre = [0.5] * (dim - 1) + [-radius - gap]
    body = {random.pick(["sphere", "cylinder"]): {"centre": centre, "radius": radius}}
    value = down(dim, gap * random.between(0.0, 0.9))
    data = _moved(random, random.unit_block(dim), value, gap=body)
    return Case(data, Truth(admissible=True, touches=False, translation=tuple(value)))


@family
def just_touching(random: Random) -> Case:
    """Moved by the gap, to rounding, or by a little more."""
    dim, gap = random.pick([2, 2, 3]), random.decades(-4.0, -1.0)
    excess = random.pick([0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-8, 1e-6, 1e-3])
    value = down(dim, gap * (1.0 + excess))
    data = _moved(random, random.unit_block(dim), value, gap=gap)
    touches = False if excess < 0.0 else None
    return Case(data, Truth(admissible=True, touches=touches))


@family
def first_touch(random: Random) -> Case:
    """A round body whose top is lowered until its lowest point touches, and not beyond."""
    radius = random.pick([1.0, 2.0])
    mesh = {"builder": "disc", "radius": radius, "contact_width": 0.5 * radius, "h": 0.3 * radius}
    gap = random.decades(-4.0, -2.0)
    plane = {"half_space": {"point": [0.0, -gap], "normal": [0.0, 1.0]}}
    value = down(2, gap * random.pick([1.0, 1.0 - 1e-14, 0.999999, 1.000001]))
    data = _moved(random, mesh, value, gap=plane, on="contact")
    return Case(data, Truth(admissible=True))


@family
def rigid_motion(random: Random) -> Case:
    """A translation along a foundation that is touched but not pressed, or a small rotation."""
    dim = 2
    if random.chance(0.3):
        angle = random.decades(-4.0, -2.0)
        loads = {"displacements": [{"on": "left", "value": [f"-{angle}*y", f"{angle}*x"]}]}
        data = random.rubbing(random.unit_block(dim), loads, gap=random.pick([0.0, 0.01]))
        return Case(data, Truth(admissible=True, touches=False))
    dim = random.pick([2, 2, 3])
    value = [*random.vector(dim - 1, random.decades(-4.0, 0.0)), 0.0]
    data = _moved(random, random.unit_block(dim), value)
    return Case(data, Truth(admissible=True, translation=tuple(value)))


@family
def grazing(random: Random) -> Case:
    """A clamped block, hardly or not quite bent down to the foundation by a small load."""
    dim = random.pick([2, 2, 3])
    gap = random.decades(-4.0, -2.0)
    pressure = gap * random.decades(-3.0, 0.5)
    loads = {
        "tractions": [{"on": random.pick(["right", "top"]), "value": down(dim, pressure)}],
        "displacements": [clamp(dim)],
    }
    data = random.rubbing(
        random.unit_block(dim), loads, limit=random.pick([math.inf, USUAL_STRAIN]), gap=gap
    )
    return Case(data, Truth(admissible=True))
