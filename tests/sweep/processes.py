"""Families of processes: steps, tools, foundations on springs, kinds of bodies and units."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from .case import Case, Random, Study, Truth, family

# Young's modulus and the size of the body: none, steel in SI units and in mm and MPa, and rubber.
_UNITS = ((1.0, 1.0), (2.1e11, 0.1), (2.1e5, 100.0), (1e6, 0.02))
# A study that nothing holds is refused with these words.
_LOOSE = "leave a rigid motion free"


@dataclass(frozen=True)
class _Draft:
    """The random numbers of a process in units of a modulus and a length.

    ``strain`` is the size of the strains, ``width`` and ``height`` are those of the body relative
    to the length, and ``time`` is the last time.
    """

    random: Random
    young: float
    length: float
    body: str
    strain: float
    width: float
    height: float
    time: float

    def at(self, size: float) -> float:
        """A length."""
        return float(f"{size * self.length:.12g}")

    def law(self, size: float) -> str:
        """A value of this size that depends on the time."""
        shape = self.random.pick(["1", "t/T", "sin(pi*t/T)", "(0.6 - 0.4*cos(2*pi*t/T))"])
        return f"{size:.12g}*{shape.replace('T', repr(self.time))}"

    @property
    def axisymmetric(self) -> bool:
        return self.body == "axisymmetric"

    @property
    def force(self) -> float:
        """A force that strains the body by about ``strain``."""
        area = math.pi * self.width**2 * self.length if self.axisymmetric else self.width
        return self.strain * self.young * area * self.length


def study_of(random: Random, young: float, length: float) -> Study:
    """A random process in units of a modulus and a length."""
    draft = _Draft(
        random,
        young,
        length,
        body=random.pick(["strain", "stress", "axisymmetric"]),
        strain=random.decades(-5.0, -1.8),
        width=random.between(0.5, 2.0),
        height=random.between(0.4, 1.5),
        time=random.pick([1.0, 2.0, 10.0]),
    )
    loads: Study = {}
    contacts = [_below(draft), *_above(draft, loads)]
    _hold(draft, loads)
    n = random.pick([math.inf, math.inf, random.decades(1.0, 5.0)])
    # A length at which friction is regularised as the penalty of contact would do it.
    soft = {} if math.isinf(n) else {"regularisation": draft.at(1.0 / n)}
    study: Study = {
        "mesh": _mesh(draft),
        "material": _material(draft),
        "loads": loads,
        "contact": contacts,
        "friction": {
            "coefficient": random.friction(),
            "smoothing": {
                "kernel": random.pick(["none", "convolution", "helmholtz"]),
                "radius": draft.at(0.3),
            },
            **soft,
        },
        "penalty": {"n": n} if not soft else {"n": n * young, "epsilon": length / (n * young)},
        "steps": {"to": draft.time, "count": int(random.integers(2, 5))},
    }
    return study


def _mesh(draft: _Draft) -> Study:
    random, width, height = draft.random, draft.width, draft.height
    h = min(max(width, height) / random.pick([3, 4, 6]), min(width, height) / 2)
    return {
        "builder": "block",
        "dim": 2,
        "size": [draft.at(width), draft.at(height)],
        "h": draft.at(h),
        # The triangles of Gmsh may be others in other units.
        "structured": True,
        **({"axisymmetric": True} if draft.axisymmetric else {}),
    }


def _material(draft: _Draft) -> Study:
    random = draft.random
    limit = math.inf if random.chance(0.4) else draft.strain * random.decades(-0.5, 1.0)
    poisson = random.pick([0.0, 0.2, 0.3, 0.45, 0.49])
    elasticity = {"young": draft.young, "poisson": poisson}
    plane = {"plane": "stress"} if draft.body == "stress" else {}
    return {"elasticity": elasticity, "locking_limit": limit, **plane}


def _below(draft: _Draft) -> Study:
    random, strain = draft.random, draft.strain
    room = random.pick([0.0, 0.0, 0.2 * strain, strain])
    kind = random.pick(["half_space", "gap", "sphere", "oblique"])
    if kind == "gap":
        return {"on": "bottom", "gap": draft.at(room)}
    if kind == "sphere":
        radius = random.between(0.5, 3.0)
        middle = 0.0 if draft.axisymmetric else 0.5 * draft.width
        ball = {"centre": [draft.at(middle), draft.at(-radius - room)], "radius": draft.at(radius)}
        return {"on": "bottom", "foundation": {"sphere": ball}}
    slope = random.between(-0.1, 0.1) if kind == "oblique" and not draft.axisymmetric else 0.0
    point = [0.0, draft.at(-room - abs(slope) * draft.width)]
    return {"on": "bottom", "foundation": {"half_space": {"point": point, "normal": [-slope, 1.0]}}}


def _above(draft: _Draft, loads: Study) -> list[Study]:
    """What presses the body: a tool, which is returned, or an entry of the loads."""
    random, strain, straight = draft.random, draft.strain, draft.axisymmetric
    kind = random.pick(["force", "force", "motion", "traction", "displacement"])
    if kind == "traction":
        shear = 0.0 if straight else draft.law(random.between(-0.3, 0.3) * strain * draft.young)
        value: list[Any] = [shear, f"-({draft.law(strain * draft.young)})"]
        loads["tractions"] = [{"on": "top", "value": value}]
        return []
    way = strain * draft.height * draft.length
    if kind == "displacement":
        loads["displacements"] = [{"on": "top", "value": [None, f"-({draft.law(way)})"]}]
        return []
    tool: Study = {"half_space": {"point": [0.0, draft.at(draft.height)], "normal": [0.0, -1.0]}}
    if random.chance(0.3):
        radius = random.between(1.0, 3.0)
        middle = 0.0 if straight else 0.5 * draft.width
        centre = [draft.at(middle), draft.at(draft.height + radius)]
        tool = {"sphere": {"centre": centre, "radius": draft.at(radius)}}
    if kind == "force":
        down = f"-({draft.law(draft.force)})"
        share = 0.0 if straight or random.chance(0.7) else random.between(-0.3, 0.3)
        tool["force"] = [f"{share}*({down})" if share else 0.0, down]
    else:
        drag = 0.0 if straight else draft.law(random.between(-1.0, 1.0) * way)
        tool["motion"] = [drag, f"-({draft.law(way)})"]
    return [{"on": "top", "foundation": tool}]


def _hold(draft: _Draft, loads: Study) -> None:
    """What holds the body sideways, if anything does."""
    random, strain = draft.random, draft.strain
    kind = random.pick(["support", "support", "normal", "clamp", "none"])
    if draft.axisymmetric:
        if kind == "normal":
            loads["supports"] = [{"on": "right", "along": "normal"}]
        return
    if kind == "support":
        pull = draft.law(random.between(-0.3, 0.3) * strain * draft.length)
        along = [1.0, random.between(-0.5, 0.5)]
        loads["supports"] = [{"on": "left", "along": along, "value": random.pick([0.0, pull])}]
    elif kind == "normal":
        loads["supports"] = [{"on": "left", "along": "normal"}]
    elif kind == "clamp":
        # The top may be moved along y.
        y = None if loads.get("displacements") else 0.0
        loads.setdefault("displacements", []).append({"on": "left", "value": [0.0, y]})
    if kind != "none" and random.chance(0.3):
        side = draft.law(random.between(-0.3, 0.3) * strain * draft.young)
        loads.setdefault("tractions", []).append({"on": "right", "value": [side, 0.0]})


@family
def process(random: Random) -> Case:
    """A body in any units between a foundation and a tool, a load or a moved top, in steps."""
    seed = int(random.integers(2**32))
    young, length = random.pick(_UNITS)
    return Case(study_of(Random.of(seed), young, length), Truth(maybe=_LOOSE))


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
        young, length = random.pick(UNITS)
        strain = random.decades(-4.0, -2.0)
        limit = math.inf if random.chance() else float(f"{strain * random.between(1.0, 4.0):.6g}")
        return cls(random, dim, young, length, strain, limit, random.chance(0.3))

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
        random, share = self.random, self.random.decades(2.0, 4.0)
        steps: Study = {"steps": {"to": 1.0, "count": 2}} if self.timed else {}
        smoothing = random.kernel(0.4)
        smoothing["radius"] *= self.length
        rubs: Study = {"coefficient": friction, "smoothing": smoothing}
        penalty: Study = {"n": math.inf}
        if random.chance(0.3):
            softness = self.length / (share * self.young)
            penalty = {"n": share * self.young, "epsilon": float(f"{softness:.6g}")}
            rubs["regularisation"] = float(f"{1e-3 * self.strain * self.length:.6g}")
        elasticity = {"young": self.young, "poisson": random.between(0.0, 0.45)}
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
    room = random.pick([0.0, 0.2, 1.0]) * scale.depth
    middle = [0.5] * (dim - 1)
    if random.chance(0.3):
        radius = random.between(1.5, 5.0)
        ball = {"centre": scale.at(*middle, top + room + radius), "radius": scale.at(radius)[0]}
        return {"sphere": ball}
    slope = random.vector(dim - 1, scale.depth)
    return {"half_space": {"point": scale.at(*middle, top + room), "normal": [*slope, -1.0]}}


def spring(scale: Scale, foundation: Study, at_rest: bool) -> None:
    """A spring, which a force or the motion of its far end presses onto the body."""
    random, dim = scale.random, scale.dim
    stiffness = random.decades(-2.0, 2.0) * scale.young * scale.length ** (dim - 2)
    lean = random.vector(dim - 1, 0.3)
    given: Study = {"stiffness": float(f"{stiffness:.6g}")}
    if random.chance():
        size = scale.force * random.between(0.1, 0.5)
        foundation["force"] = scale.over_time(*(size * x for x in lean), -size)
    else:
        given["along"] = [*lean, random.pick([1.0, -1.0, 3.0])]
    if not at_rest:
        way = scale.depth * scale.length
        foundation["motion"] = scale.over_time(*random.vector(dim - 1, 0.5 * way), -way)
    foundation["spring"] = given


def held_block(scale: Scale, held: bool) -> tuple[Study, Study]:
    """The unit block and its loads; a body that is not ``held`` is free to rise."""
    random, dim = scale.random, scale.dim
    mesh: Study = {"builder": "block", "dim": dim, "size": scale.at(*[1.0] * dim)}
    mesh["h"] = scale.at({2: 0.25, 3: 0.5}[dim])[0]
    mesh["structured"] = random.chance()
    stress = scale.strain * scale.young
    loads: Study = {}
    if held:
        lift = scale.over_time(*[0.0] * (dim - 1), random.pick([0.0, scale.depth * scale.length]))
        loads["displacements"] = [{"on": "bottom", "value": lift}]
        pull = random.vector(dim, 0.3 * stress)
        loads["tractions"] = [{"on": "right", "value": scale.over_time(*pull)}]
    else:
        sides = [{"on": "left", "value": [0.0, *[None] * (dim - 1)]}]
        if dim == 3:
            sides.append({"on": "front", "value": [None, 0.0, None]})
        push = stress * random.between(0.05, 0.3)
        loads["displacements"] = sides
        up = scale.over_time(*[0.0] * (dim - 1), push)
        loads["tractions"] = [{"on": "bottom", "value": up}]
    return mesh, loads


def _element(random: Random) -> Study:
    return {"degree": random.pick([1, 2])}


@family
def sprung(random: Random) -> Case:
    """A block below a foundation on a spring, which alone holds some of the blocks."""
    scale = Scale.draw(random, random.pick([2, 2, 3]))
    held = random.chance(0.7)
    mesh, loads = held_block(scale, held)
    foundation = plate(scale, 1.0)
    spring(scale, foundation, at_rest=not held or random.chance(0.3))
    friction = random.pick([0.0, 0.2, 0.5]) if held else 0.0
    study = scale.study(mesh, loads, {"on": "top", "foundation": foundation}, friction)
    return Case(study | {"discretisation": _element(random)})
