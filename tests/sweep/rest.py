"""Families with little or nothing to do: the body rests, approaches, or only just touches."""

from __future__ import annotations

import math
from typing import Any

from .case import (
    USUAL_STRAIN,
    Case,
    Random,
    Study,
    Truth,
    between,
    chance,
    clamp,
    decades,
    down,
    family,
    pick,
    some_friction,
    some_kernel,
    study,
    unit_block,
    vector,
)


def _limit(random: Random) -> float:
    return pick(random, [math.inf, 0.02, 1e-3])


def _moved(random: Random, mesh: Study, value: list[Any], **more: Any) -> Study:
    displacements = [{"on": "top", "value": value}]
    return study(
        mesh,
        {"displacements": displacements},
        limit=_limit(random),
        friction=some_friction(random),
        smoothing=some_kernel(random),
        **more,
    )


@family
def zero_load(random: Random) -> Case:
    """No load at all: u = 0 and nothing presses."""
    dim = pick(random, [2, 2, 3])
    loads: Study = {"displacements": [clamp(dim, pick(random, ["left", "top"]))]}
    if chance(random):
        loads["tractions"] = [{"on": "right", "value": [0.0] * dim}]
    data = study(
        unit_block(random, dim),
        loads,
        limit=_limit(random),
        gap=pick(random, [0.0, 0.01]),
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True, touches=False, translation=(0.0,) * dim))


@family
def approach(random: Random) -> Case:
    """The top is moved towards a foundation that is farther away: a translation."""
    dim = pick(random, [2, 2, 3])
    gap = decades(random, -4.0, 0.0)
    *along, _ = vector(random, dim, 0.3 * gap)
    value = [*along, -gap * between(random, 0.0, 0.9)]
    data = _moved(random, unit_block(random, dim), value, gap=gap)
    return Case(data, Truth(admissible=True, touches=False, translation=tuple(value)))


@family
def approach_curved(random: Random) -> Case:
    """The same towards a sphere or a cylinder below the body."""
    dim = pick(random, [2, 2, 3])
    radius, gap = between(random, 0.3, 3.0), decades(random, -4.0, -1.0)
    centre = [0.5] * (dim - 1) + [-radius - gap]
    body = {pick(random, ["sphere", "cylinder"]): {"centre": centre, "radius": radius}}
    value = down(dim, gap * between(random, 0.0, 0.9))
    data = _moved(random, unit_block(random, dim), value, gap=body)
    return Case(data, Truth(admissible=True, touches=False, translation=tuple(value)))


@family
def just_touching(random: Random) -> Case:
    """Moved by the gap, to rounding, or by a little more."""
    dim, gap = pick(random, [2, 2, 3]), decades(random, -4.0, -1.0)
    excess = pick(random, [0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-8, 1e-6, 1e-3])
    value = down(dim, gap * (1.0 + excess))
    data = _moved(random, unit_block(random, dim), value, gap=gap)
    touches = False if excess < 0.0 else None
    return Case(data, Truth(admissible=True, touches=touches))


@family
def first_touch(random: Random) -> Case:
    """A round body whose top is lowered until its lowest point touches, and not beyond."""
    radius = pick(random, [1.0, 2.0])
    mesh = {"builder": "disc", "radius": radius, "contact_width": 0.5 * radius, "h": 0.3 * radius}
    gap = decades(random, -4.0, -2.0)
    plane = {"half_space": {"point": [0.0, -gap], "normal": [0.0, 1.0]}}
    value = down(2, gap * pick(random, [1.0, 1.0 - 1e-14, 0.999999, 1.000001]))
    data = _moved(random, mesh, value, gap=plane, on="contact")
    return Case(data, Truth(admissible=True))


@family
def rigid_motion(random: Random) -> Case:
    """A translation along a foundation that is touched but not pressed, or a small rotation."""
    dim = 2
    if chance(random, 0.3):
        angle = decades(random, -4.0, -2.0)
        loads = {"displacements": [{"on": "left", "value": [f"-{angle}*y", f"{angle}*x"]}]}
        data = study(
            unit_block(random, dim),
            loads,
            gap=pick(random, [0.0, 0.01]),
            friction=some_friction(random),
            smoothing=some_kernel(random),
        )
        return Case(data, Truth(admissible=True, touches=False))
    dim = pick(random, [2, 2, 3])
    value = [*vector(random, dim - 1, decades(random, -4.0, 0.0)), 0.0]
    data = _moved(random, unit_block(random, dim), value)
    return Case(data, Truth(admissible=True, translation=tuple(value)))


@family
def grazing(random: Random) -> Case:
    """A clamped block, hardly or not quite bent down to the foundation by a small load."""
    dim = pick(random, [2, 2, 3])
    gap = decades(random, -4.0, -2.0)
    pressure = gap * decades(random, -3.0, 0.5)
    loads = {
        "tractions": [{"on": pick(random, ["right", "top"]), "value": down(dim, pressure)}],
        "displacements": [clamp(dim)],
    }
    data = study(
        unit_block(random, dim),
        loads,
        limit=pick(random, [math.inf, USUAL_STRAIN]),
        gap=gap,
        friction=some_friction(random),
        smoothing=some_kernel(random),
    )
    return Case(data, Truth(admissible=True))
