"""Families of bodies that contact or friction alone holds, or does not hold in every direction."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from .case import (
    Case,
    Random,
    Study,
    Truth,
    between,
    chance,
    decades,
    down,
    family,
    pick,
    study,
    unit_block,
)


@family
def play(random: Random) -> Case:
    """A block on rollers between two foundations: pinched, pressed onto one of them, or loose.

    Loose, it may be moved by as much as the gaps leave; otherwise no other displacement solves the
    problem.  A tool above a clamped block may travel if no force pushes it.
    """
    if chance(random, 0.25):
        return _tool(random)
    dim = pick(random, [2, 2, 3])
    size, kind = decades(random, -5.0, -2.0), pick(random, ["loose", "pressed", "pinched"])
    free: list[Any] = [None] * (dim - 1)
    sides: list[Study] = [{"on": "left", "value": [0.0, *free]}]
    if dim == 3:
        sides.append({"on": "front", "value": [None, 0.0, None]})
    if chance(random, 0.7):
        # The height grows by less than the gaps.
        sides.append({"on": "right", "value": [-size * between(random, 0.1, 1.0), *free]})
    loads: Study = {"displacements": sides}
    if kind == "pressed":
        loads["tractions"] = [{"on": "top", "value": down(dim, size * between(random, 0.1, 1.0))}]
    gap = -size if kind == "pinched" else size * between(random, 1.0, 20.0)
    slope = between(random, 0.0, 0.5) * abs(gap)
    data = study(
        unit_block(random, dim),
        loads,
        limit=pick(random, [math.inf, 5.0 * size]),
        gap=pick(random, [gap, f"{gap} + {slope}*x"]),
        on=["bottom", "top"],
        penalty=pick(random, [None, {"n": 1e4}]),
    )
    if kind != "loose":
        return Case(data, Truth(unique=True, touches=True))
    up = (*[0.0] * (dim - 1), 0.2 * gap)
    return Case(data, Truth(admissible=True, unique=False, other=up))


def _tool(random: Random) -> Case:
    """A clamped block below a tool whose force is zero at the last time, or is not."""
    size, pushes = decades(random, -5.0, -2.0), chance(random)
    height = 1.0 + pick(random, [0.0, 0.1, 2.0]) * size
    last = "t" if pushes else "max(1 - t, 0)"
    space = {"point": [0.0, height], "normal": [0.0, -1.0]}
    data = study(
        unit_block(random, 2),
        {"displacements": [{"on": "bottom", "value": [0.0, 0.0]}]},
        gap={"half_space": space, "force": [0.0, f"-{size}*{last}"]},
        on="top",
    )
    data["steps"] = {"times": [0.5, 1.0]}
    return Case(data, Truth(unique=pushes), twin=copy.deepcopy(data))


@family
def hardening(random: Random) -> Case:
    """Friction that grows with the slip and alone holds a block: the slip is known exactly.

    Without Poisson's effect the block is in uniform compression, and its foot slips until mu times
    the pressure is the shear.  Below mu(0) times the pressure it sticks.
    """
    dim, pressure = pick(random, [2, 2, 3]), decades(random, -5.0, -2.0)
    least, more = between(random, 0.0, 0.5), between(random, 0.05, 1.0)
    length = float(f"{pressure * decades(random, -2.0, 1.0):.4g}")
    share = pick(random, [-1.0, 1.0, 1.0, 1.0]) * between(random, 0.05, 0.7)
    law, slip = {
        "line": (f"min(s/{length}, 1)", share * length),
        "hyperbola": (f"s/(s + {length})", length * share / (1.0 - share)),
        "exponential": (f"(1 - exp(-s/{length}))", -length * math.log(1.0 - share)),
    }[pick(random, ["line", "hyperbola", "exponential"])]
    # A negative share is one of mu(0): the foot sticks.
    needed = least * (1.0 + share) if share < 0.0 else least + more * share
    angle = between(random, 0.0, 6.28)
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
        unit_block(random, dim),
        loads,
        poisson=0.0,
        friction=f"{least} + {more}*{law}",
        smoothing={"kernel": pick(random, ["convolution", "helmholtz"]), "radius": 0.6},
    )
    foot = tuple(max(slip, 0.0) * np.array(along))
    return Case(data, Truth(admissible=True, touches=True, slip=foot))
