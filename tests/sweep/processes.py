"""The family of processes: steps, tools, supports, kinds of bodies and units, put together."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .case import Case, Random, Study, Truth, between, chance, decades, family, pick, some_friction

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
        shape = pick(self.random, ["1", "t/T", "sin(pi*t/T)", "(0.6 - 0.4*cos(2*pi*t/T))"])
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
        body=pick(random, ["strain", "stress", "axisymmetric"]),
        strain=decades(random, -5.0, -1.8),
        width=between(random, 0.5, 2.0),
        height=between(random, 0.4, 1.5),
        time=pick(random, [1.0, 2.0, 10.0]),
    )
    loads: Study = {}
    contacts = [_below(draft), *_above(draft, loads)]
    _hold(draft, loads)
    n = pick(random, [math.inf, math.inf, decades(random, 1.0, 5.0)])
    # A length at which friction is regularised as the penalty of contact would do it.
    soft = {} if math.isinf(n) else {"regularisation": draft.at(1.0 / n)}
    study: Study = {
        "mesh": _mesh(draft),
        "material": _material(draft),
        "loads": loads,
        "contact": contacts,
        "friction": {
            "coefficient": some_friction(random),
            "smoothing": {
                "kernel": pick(random, ["none", "convolution", "helmholtz"]),
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
    h = min(max(width, height) / pick(random, [3, 4, 6]), min(width, height) / 2)
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
    limit = math.inf if chance(random, 0.4) else draft.strain * decades(random, -0.5, 1.0)
    poisson = pick(random, [0.0, 0.2, 0.3, 0.45, 0.49])
    elasticity = {"young": draft.young, "poisson": poisson}
    plane = {"plane": "stress"} if draft.body == "stress" else {}
    return {"elasticity": elasticity, "locking_limit": limit, **plane}


def _below(draft: _Draft) -> Study:
    random, strain = draft.random, draft.strain
    room = pick(random, [0.0, 0.0, 0.2 * strain, strain])
    kind = pick(random, ["half_space", "gap", "sphere", "oblique"])
    if kind == "gap":
        return {"on": "bottom", "gap": draft.at(room)}
    if kind == "sphere":
        radius = between(random, 0.5, 3.0)
        middle = 0.0 if draft.axisymmetric else 0.5 * draft.width
        ball = {"centre": [draft.at(middle), draft.at(-radius - room)], "radius": draft.at(radius)}
        return {"on": "bottom", "foundation": {"sphere": ball}}
    slope = between(random, -0.1, 0.1) if kind == "oblique" and not draft.axisymmetric else 0.0
    point = [0.0, draft.at(-room - abs(slope) * draft.width)]
    return {
        "on": "bottom",
        "foundation": {"half_space": {"point": point, "normal": [-slope, 1.0]}},
    }


def _above(draft: _Draft, loads: Study) -> list[Study]:
    """What presses the body: a tool, which is returned, or an entry of the loads."""
    random, strain, straight = draft.random, draft.strain, draft.axisymmetric
    kind = pick(random, ["force", "force", "motion", "traction", "displacement"])
    if kind == "traction":
        shear = 0.0 if straight else draft.law(between(random, -0.3, 0.3) * strain * draft.young)
        value: list[Any] = [shear, f"-({draft.law(strain * draft.young)})"]
        loads["tractions"] = [{"on": "top", "value": value}]
        return []
    way = strain * draft.height * draft.length
    if kind == "displacement":
        loads["displacements"] = [{"on": "top", "value": [None, f"-({draft.law(way)})"]}]
        return []
    tool: Study = {"half_space": {"point": [0.0, draft.at(draft.height)], "normal": [0.0, -1.0]}}
    if chance(random, 0.3):
        radius = between(random, 1.0, 3.0)
        middle = 0.0 if straight else 0.5 * draft.width
        centre = [draft.at(middle), draft.at(draft.height + radius)]
        tool = {"sphere": {"centre": centre, "radius": draft.at(radius)}}
    if kind == "force":
        down = f"-({draft.law(draft.force)})"
        share = 0.0 if straight or chance(random, 0.7) else between(random, -0.3, 0.3)
        tool["force"] = [f"{share}*({down})" if share else 0.0, down]
    else:
        drag = 0.0 if straight else draft.law(between(random, -1.0, 1.0) * way)
        tool["motion"] = [drag, f"-({draft.law(way)})"]
    return [{"on": "top", "foundation": tool}]


def _hold(draft: _Draft, loads: Study) -> None:
    """What holds the body sideways, if anything does."""
    random, strain = draft.random, draft.strain
    kind = pick(random, ["support", "support", "normal", "clamp", "none"])
    if draft.axisymmetric:
        if kind == "normal":
            loads["supports"] = [{"on": "right", "along": "normal"}]
        return
    if kind == "support":
        pull = draft.law(between(random, -0.3, 0.3) * strain * draft.length)
        along = [1.0, between(random, -0.5, 0.5)]
        loads["supports"] = [{"on": "left", "along": along, "value": pick(random, [0.0, pull])}]
    elif kind == "normal":
        loads["supports"] = [{"on": "left", "along": "normal"}]
    elif kind == "clamp":
        # The top may be moved along y.
        y = None if loads.get("displacements") else 0.0
        loads.setdefault("displacements", []).append({"on": "left", "value": [0.0, y]})
    if kind != "none" and chance(random, 0.3):
        side = draft.law(between(random, -0.3, 0.3) * strain * draft.young)
        loads.setdefault("tractions", []).append({"on": "right", "value": [side, 0.0]})


@family
def process(random: Random) -> Case:
    """A body in any units between a foundation and a tool, a load or a moved top, in steps."""
    seed = int(random.integers(2**32))
    young, length = pick(random, _UNITS)
    study, twin = (
        study_of(np.random.default_rng(seed), *units) for units in ((young, length), (1.0, 1.0))
    )
    return Case(study, Truth(refused=_LOOSE), twin=twin)
