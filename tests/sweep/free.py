"""Families of foundations on springs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .case import Case, Random, Study, between, chance, decades, family, pick, some_kernel, vector

#: Young's modulus and the size of the body: none, steel in mm and MPa, and rubber.
UNITS = ((1.0, 1.0), (2.1e5, 100.0), (1e6, 0.02))


@dataclass(frozen=True)
class Scale:
    """The units of a problem, its strains and its limit, and whether it has steps."""

    random: Random
    dim: int
    young: float
    length: float
    strain: float
    limit: float
    timed: bool

    @classmethod
    def draw(cls, random: Random, dim: int) -> Scale:
        young, length = pick(random, UNITS)
        strain = decades(random, -4.0, -2.0)
        limit = math.inf if chance(random) else float(f"{strain * between(random, 1.0, 4.0):.6g}")
        return cls(random, dim, young, length, strain, limit, chance(random, 0.3))

    @property
    def depth(self) -> float:
        """How far foundations move, in lengths of the body, so that no limit is exceeded."""
        return 0.15 * self.strain

    @property
    def force(self) -> float:
        """A force that strains a body of unit size by ``strain``."""
        return self.strain * self.young * self.length ** (self.dim - 1)

    def at(self, *parts: float) -> list[float]:
        """Lengths."""
        return [float(f"{part * self.length:.12g}") for part in parts]

    def over_time(self, *sizes: float) -> list[Any]:
        return [f"{x:.12g}*t" if self.timed and x else float(f"{x:.12g}") for x in sizes]

    def study(self, mesh: Study, loads: Study, contact: Study, friction: float) -> Study:
        """The study, exact or with a penalty."""
        random, share = self.random, decades(self.random, 2.0, 4.0)
        steps: Study = {"steps": {"to": 1.0, "count": 2}} if self.timed else {}
        smoothing = some_kernel(random, 0.4)
        smoothing["radius"] *= self.length
        rubs: Study = {"coefficient": friction, "smoothing": smoothing}
        penalty: Study = {"n": math.inf}
        if chance(random, 0.3):
            softness = self.length / (share * self.young)
            penalty = {"n": share * self.young, "epsilon": float(f"{softness:.6g}")}
            rubs["regularisation"] = float(f"{1e-3 * self.strain * self.length:.6g}")
        elasticity = {"young": self.young, "poisson": between(random, 0.0, 0.45)}
        return {
            "mesh": mesh,
            "material": {"elasticity": elasticity, "locking_limit": self.limit},
            "loads": loads,
            "contact": [contact],
            "friction": rubs,
            "penalty": penalty,
            **steps,
        }


def plate(scale: Scale, top: float) -> Study:
    """A plane or a ball above a body of this height."""
    random, dim = scale.random, scale.dim
    room = pick(random, [0.0, 0.2, 1.0]) * scale.depth
    middle = [0.5] * (dim - 1)
    if chance(random, 0.3):
        radius = between(random, 1.5, 5.0)
        ball = {"centre": scale.at(*middle, top + room + radius), "radius": scale.at(radius)[0]}
        return {"sphere": ball}
    slope = vector(random, dim - 1, scale.depth)
    return {"half_space": {"point": scale.at(*middle, top + room), "normal": [*slope, -1.0]}}


def spring(scale: Scale, foundation: Study, at_rest: bool) -> None:
    """A spring, which a force or the motion of its far end presses onto the body."""
    random, dim = scale.random, scale.dim
    stiffness = decades(random, -2.0, 2.0) * scale.young * scale.length ** (dim - 2)
    lean = vector(random, dim - 1, 0.3)
    given: Study = {"stiffness": float(f"{stiffness:.6g}")}
    if chance(random):
        size = scale.force * between(random, 0.1, 0.5)
        foundation["force"] = scale.over_time(*(size * x for x in lean), -size)
    else:
        given["along"] = [*lean, pick(random, [1.0, -1.0, 3.0])]
    if not at_rest:
        way = scale.depth * scale.length
        foundation["motion"] = scale.over_time(*vector(random, dim - 1, 0.5 * way), -way)
    foundation["spring"] = given


def held_block(scale: Scale, held: bool) -> tuple[Study, Study]:
    """The unit block and its loads; a body that is not ``held`` is free to rise."""
    random, dim = scale.random, scale.dim
    mesh: Study = {"builder": "block", "dim": dim, "size": scale.at(*[1.0] * dim)}
    mesh["h"] = scale.at({2: 0.25, 3: 0.5}[dim])[0]
    mesh["structured"] = chance(random)
    stress = scale.strain * scale.young
    loads: Study = {}
    if held:
        lift = scale.over_time(*[0.0] * (dim - 1), pick(random, [0.0, scale.depth * scale.length]))
        loads["displacements"] = [{"on": "bottom", "value": lift}]
        pull = vector(random, dim, 0.3 * stress)
        loads["tractions"] = [{"on": "right", "value": scale.over_time(*pull)}]
    else:
        sides = [{"on": "left", "value": [0.0, *[None] * (dim - 1)]}]
        if dim == 3:
            sides.append({"on": "front", "value": [None, 0.0, None]})
        push = stress * between(random, 0.05, 0.3)
        loads["displacements"] = sides
        up = scale.over_time(*[0.0] * (dim - 1), push)
        loads["tractions"] = [{"on": "bottom", "value": up}]
    return mesh, loads


def _element(random: Random) -> Study:
    return {"degree": pick(random, [1, 2])}


@family
def sprung(random: Random) -> Case:
    """A block below a foundation on a spring, which alone holds some of the blocks."""
    scale = Scale.draw(random, pick(random, [2, 2, 3]))
    held = chance(random, 0.7)
    mesh, loads = held_block(scale, held)
    foundation = plate(scale, 1.0)
    spring(scale, foundation, at_rest=not held or chance(random, 0.3))
    friction = pick(random, [0.0, 0.2, 0.5]) if held else 0.0
    study = scale.study(mesh, loads, {"on": "top", "foundation": foundation}, friction)
    return Case(study | {"discretisation": _element(random)})
