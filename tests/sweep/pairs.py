"""The family of pairs: a random problem for a row of the covering design.

Lengths are in units of ``L``, stresses in units of ``E``.  Strains are about as large as ``s``, or
as the limit of the strain where this is less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .case import Case, Random, Study
from .covering import Row
from .pair_features import LOOSE, rows

#: The name of the family, which `make sweep` solves on demand.
PAIRS = "pairs"
# Young's modulus and the size of the body: none, steel in SI units and in mm and MPa, and rubber.
_UNITS = {"one": (1.0, 1.0), "pascal": (2.1e11, 0.1), "mm": (2.1e5, 100.0), "rubber": (1e6, 0.02)}
# Loads relative to those that strain the body by s; the weight of a body without other loads.
_LOADS = {"huge": 100.0, "tiny": 1e-8, "none": 0.3}


@dataclass(frozen=True)
class _Body:
    """Names of parts, the lowest point of the contact and the way up from the foundation."""

    contact: str
    hold: str
    load: str
    base: tuple[float, ...]
    up: float
    width: float
    height: float


def pairs(random: Random, seed: int) -> Case:
    """The row ``seed`` modulo their number, with random numbers."""
    design = rows()
    row = design[seed % len(design)]
    return Case(_Draft(random, row).study(), row=" ".join(row.values()))


class _Draft:
    """The random numbers of a problem, and its sections one by one."""

    def __init__(self, random: Random, row: Row) -> None:
        self.random, self.row = random, row
        self.young, self.length = _UNITS[row["units"]]
        self.dim = 3 if row["kind"] == "space" else 2
        self.axisymmetric = row["kind"] == "axisymmetric"
        self.loose = row["support"] in LOOSE
        # Whether what holds the body lets it slide where loads may press it.
        self.slides = self.loose and row["support"] != "normal"
        self.timed = row["time"] != "static"
        self.s = random.decades(-4.0, -2.0)
        share = {"none": math.inf, "tight": 0.5}.get(row["limit"], random.between(1.0, 4.0))
        self.limit = self.s * share
        self.depth = 0.15 * min(self.s, self.limit)
        self.room = random.pick([0.0, 0.2, 1.0]) * self.depth
        idle = row["load"] == "none" and row["motion"] == "none" and row["support"] != "moved"
        if idle and not self.loose:
            self.room = -self.depth
        self.body, self.mesh = self._mesh()

    def study(self) -> Study:
        row = self.row
        study: Study = {"mesh": self.mesh, "material": self._material()}
        study |= {"loads": self._loads(), "contact": self._contacts(), "friction": self._friction()}
        study["discretisation"] = {"degree": 1 if row["element"] == "linear" else 2}
        study["penalty"] = self._penalty(study["friction"])
        study["solver"] = {"linear": row["linear"]}
        if self.timed:
            times: dict[str, Study] = {
                "steps": {"to": 1.0, "count": 2},
                "uneven": {"times": [0.2, 1.0]},
            }
            study["steps"] = times[row["time"]] | {"least": 0.2}
        return study

    def _at(self, size: float) -> float:
        """A length."""
        return float(f"{size * self.length:.12g}")

    def _over_time(self, size: float) -> float | str:
        return f"{size:.12g}*t" if self.timed and size else float(f"{size:.12g}")

    def _vector(self, *parts: float) -> list[Any]:
        return [self._over_time(part) for part in parts]

    def _up(self, size: float, along: float = 0.0) -> list[float]:
        """A vector away from the foundation, and along it."""
        along = 0.0 if self.axisymmetric else along
        return [along, *[0.0] * (self.dim - 2), self.body.up * size]

    def _mesh(self) -> tuple[_Body, Study]:
        random, dim, name = self.random, self.dim, self.row["body"]
        width, height = random.between(1.0, 1.6), random.between(0.8, 1.2)
        fine = self.row["element"] == "linear"
        h = {2: 0.15 if fine else 0.25, 3: 0.35 if fine else 0.5}[dim]
        mesh: Study = {"h": self._at(h)}
        if self.axisymmetric:
            mesh["axisymmetric"] = True
        if name in ("round", "ring"):
            if name == "ring":
                mesh |= {"builder": "annulus", "inner_radius": self._at(0.5)}
                mesh["outer_radius"] = self._at(1.0)
                return _Body("outer", "inner", "outer", (0.0, -1.0), 1.0, 2.0, 1.0), mesh
            mesh |= {"builder": "disc" if dim == 2 else "ball", "radius": self._at(1.0)}
            mesh |= {"contact_width": self._at(0.6), "quarter": self.axisymmetric}
            load = "top" if self.slides else "side"
            return _Body("contact", "top", load, (0.0,) * dim, 1.0, 1.2, 1.0), mesh
        size = [width, *[1.0] * (dim - 2), height]
        mesh |= {"builder": name, "dim": dim, "size": [self._at(edge) for edge in size]}
        middle = (0.0 if self.axisymmetric else 0.5 * width, *[0.5] * (dim - 2))
        if name == "punch":
            mesh["half_width"] = self._at(0.5)
            load = "bottom" if self.row["support"] == "friction" else "top"
            base = (*[0.0] * (dim - 1), height)
            return _Body("contact", "bottom", load, base, -1.0, 0.5, height), mesh
        if name == "block":
            mesh["structured"] = bool(random.random() < 0.5)
        hold, load = "left", "top"
        if self.axisymmetric:
            hold, load = "top", "top" if self.slides else "right"
        if name == "l_shape":
            load = "inner_horizontal"
            mesh["h"] = self._at(min(h, 0.4 * height))
        if name == "inclusion":
            mesh["radius"] = self._at(0.38)
            mesh["h"] = self._at(min(h, 0.38))
        return _Body("bottom", hold, load, (*middle, 0.0), 1.0, width, height), mesh

    def _material(self) -> Study:
        random, kind, E = self.random, self.row["material"], self.young
        poisson = 0.499 if kind == "incompressible" else random.between(0.0, 0.45)
        elasticity: Study = {"young": E, "poisson": poisson}
        if kind == "graded":
            elasticity["young"] = f"{E}*(1.5 + {0.4 / self.length}*x)"
        elif kind == "lame":
            elasticity = {"lambda": 0.6 * E, "mu": random.between(0.2, 0.6) * E}
        elif kind == "matrix":
            count = 4 if self.axisymmetric else self.dim * (self.dim + 1) // 2
            frame = np.linalg.qr(random.standard_normal((count, count)))[0]
            law = frame @ np.diag(random.uniform(0.5, 2.0, count)) @ frame.T * E
            elasticity = {"stiffness": (np.triu(law) + np.triu(law, 1).T).tolist()}
        material: Study = {"elasticity": elasticity} | self._limits()
        if self.row["kind"] == "plane_stress":
            material["plane"] = "stress"
        if self.row["body"] == "inclusion":
            inner: Study = {"young": random.decades(-2.0, 2.0) * E, "poisson": 0.3}
            material["regions"] = {"inclusion": {"elasticity": inner}}
        return material

    def _limits(self) -> Study:
        kind, M = self.row["limit"], float(f"{self.limit:.6g}")
        if kind in ("none", "ball", "tight"):
            return {"locking_limit": M}
        if kind == "graded":
            return {"locking_limit": f"{M}*(1.2 + {0.5 / self.length}*x)"}
        along = [1.0, *[0.3] * (self.dim - 1)]
        count = 4 if self.axisymmetric else self.dim * (self.dim + 1) // 2
        weights = np.diag(self.random.uniform(0.3, 2.0, count))
        volume = {"norm": "volume", "at_most": 2.0 * M, "at_least": -M}
        limits: dict[str, list[Study]] = {
            "deviator": [{"norm": "deviator", "at_most": M}],
            "volume": [volume],
            "direction": [{"norm": "direction", "along": along, "at_most": M, "at_least": -M}],
            "weighted": [{"norm": "weighted", "matrix": weights.tolist(), "at_most": M}],
        }
        several = [{"norm": "strain", "at_most": 1.5 * M}, volume, *limits["direction"]]
        return {"locking": (limits | {"several": several})[kind]}

    def _loads(self) -> Study:
        row, body, kind = self.row, self.body, self.row["load"]
        stress = self.s * self.young * self.random.between(0.1, 0.5) * _LOADS.get(kind, 1.0)
        # What friction alone holds is not pulled by more than half of what presses it.
        pull = {"zero": 0.0, "small": 0.02}.get(row["friction"], 0.05)
        down = self._vector(*self._up(-stress, pull * stress))
        loads = self._supports()
        weight = self._vector(*self._up(-stress / self.length))
        if kind == "varying":
            grown = [f"({part})*(1 + {0.2 / self.length}*x)" for part in down]
            loads["tractions"] = [{"on": body.load, "value": grown}]
        elif kind == "pressure":
            sign = -1.0 if body.load == "top" and body.up < 0.0 else 1.0
            loads["pressures"] = [{"on": body.load, "value": self._over_time(sign * stress)}]
        elif kind != "body_force" and (kind != "none"):
            loads["tractions"] = [{"on": body.load, "value": down}]
        if kind == "body_force" or (self.loose and kind in ("none", "pressure")):
            loads["body_force"] = weight
        return loads

    def _supports(self) -> Study:
        """Conditions of displacements; the planes of symmetry of a punch, too."""
        row, body, dim = self.row, self.body, self.dim
        zeros, support = [0.0] * dim, row["support"]
        displacements: list[Study] = []
        supports: list[Study] = []
        if support == "clamp":
            displacements.append({"on": body.hold, "value": zeros})
        elif support == "moved":
            way = self.depth * self.length
            value = [way, *zeros[1:]] if body.hold == "left" else self._up(-way, 0.3 * way)
            if row["body"] == "punch":
                # The plane of symmetry stays where it is.
                value[0] = 0.0
            displacements.append({"on": body.hold, "value": self._vector(*value)})
        elif support == "rollers":
            across = dim - 1 if body.hold == "bottom" else 0
            roller = [0.0 if axis == across else None for axis in range(dim)]
            displacements.append({"on": body.hold, "value": roller})
        elif support == "oblique":
            along = [1.0, *[0.2] * (dim - 1)]
            supports.append({"on": body.hold, "along": along[::-1] if body.up < 0 else along})
        elif support == "normal":
            supports.append({"on": body.hold, "along": "normal"})
        held: list[Any] = [None] * dim
        if row["body"] == "punch" and not self.axisymmetric:
            displacements.append({"on": "symmetry", "value": [0.0, *held[1:]]})
            if dim == 3:
                displacements.append({"on": "symmetry_y", "value": [None, 0.0, None]})
        elif dim == 3 and self.loose and support != "friction":
            side = body.hold if row["body"] == "round" else "front"
            displacements.append({"on": side, "value": [None, 0.0, None]})
        if row["body"] == "round" and support == "normal" and not self.axisymmetric:
            # The normals of the top let it slide.
            displacements.append({"on": body.hold, "value": [0.0, *held[1:]]})
        found = {"displacements": displacements, "supports": supports}
        return {name: entries for name, entries in found.items() if entries}

    def _contacts(self) -> list[Study]:
        body, depth = self.body, self.depth
        contacts: list[Study] = [{"on": body.contact} | self._foundation()]
        own = {"coefficient": 0.3, "smoothing": {"kernel": "none"}}
        if self.row["contacts"] == "wall":
            contacts.append({"on": "right", "gap": self._at(0.1 * depth), "friction": own})
        elif self.row["contacts"] == "overlap":
            again = {"on": body.contact, "gap": self._at(self.room + 0.1 * depth)}
            contacts.append(again | {"friction": own})
        return contacts

    def _foundation(self) -> Study:
        body, kind, motion = self.body, self.row["foundation"], self.row["motion"]
        room, up = self.room, body.up
        middle, s = self._at(body.base[0]), self.depth
        if kind in ("gap", "profile"):
            text = f"{self._at(room)}"
            if kind == "profile":
                text += f" + {s / self.length:.6g}*(x - {middle})**2"
            if motion == "lowered" and self.timed:
                text += f" - {self._at(s)}*t"
            elif motion == "cyclic":
                text += f" - {self._at(s)}*sin(2*pi*t)"
            elif motion == "lowered":
                text += f" - {self._at(s)}"
            return {"gap": text}
        low = [self._at(x) for x in (*body.base[:-1], body.base[-1] - up * room)]
        radius = 1.5 * body.width
        centre = [*low[:-1], self._at(body.base[-1] - up * (room + radius))]
        tilt = 0.0 if self.axisymmetric else s
        level, far = low[-1], self._at(3.0)
        # The kink is at no node.
        kink = middle + self._at(0.07)
        line = [[middle + far, level], [kink, level], [middle - far, level - up * s * far]]
        across = f"({'xyz'[self.dim - 1]} - ({level}))*({up})"
        shapes: dict[str, Any] = {
            "plane": {"half_space": {"point": low, "normal": self._up(1.0, tilt)}},
            "ball": {"sphere": {"centre": centre, "radius": self._at(radius)}},
            "cylinder": {"cylinder": {"centre": centre, "radius": self._at(radius)}},
            "expression": {"expression": f"{across} + {s / self.length:.6g}*(x - {middle})**2"},
            "polyline": {"polyline": line if up > 0.0 else line[::-1]},
        }
        return {"foundation": shapes[kind] | self._motion(low)}

    def _motion(self, base: list[float]) -> Study:
        way, motion = self.depth * self.length, self.row["motion"]
        rise = self._vector(*self._up(way))
        if motion == "lowered":
            return {"motion": rise}
        if motion == "dragged":
            return {"motion": self._vector(*self._up(way, 0.7 * way))}
        if motion == "rotating":
            angle = self._over_time(0.3 * self.depth)
            turn = angle if self.dim == 2 else [0.0, angle, 0.0]
            return {"motion": {"translation": rise, "rotation": turn, "about": base}}
        if motion == "cyclic":
            swing = 0.0 if self.axisymmetric else f"{0.7 * way:.12g}*sin(2*pi*t)"
            lift = f"{self.body.up * way:.12g}*min(3*t, 1)"
            return {"motion": [swing, *[0.0] * (self.dim - 2), lift]}
        if motion == "pushed":
            power = 2 if self.axisymmetric else self.dim - 1
            force = 2.0 * self.depth * self.young * self.body.width * self.length**power
            return {"force": self._vector(*self._up(force))}
        return {}

    def _friction(self) -> Study:
        L, kind = self.length, self.row["friction"]
        coefficient: dict[str, float | str] = {
            "zero": 0.0,
            "small": 0.2,
            "large": self.random.between(1.0, 3.0),
            "place": f"0.3 + {0.1 / L}*x",
            "slip": f"0.2 + 0.2/(1 + s/{self.s * L:.6g})",
        }
        radius = self._at({2: 0.4, 3: 0.7}[self.dim])
        smoothing = {"kernel": self.row["smoothing"], "radius": radius}
        return {"coefficient": coefficient[kind], "smoothing": smoothing}

    def _penalty(self, friction: Study) -> Study:
        kind, share = self.row["penalty"], self.random.decades(2.0, 4.0)
        slip = {"regularisation": self._at(self.s * 1e-3)}
        if kind != "exact":
            friction |= slip if kind != "soft" else {"regularisation": 0.0}
        soft = {"epsilon": float(f"{self.length / (share * self.young):.6g}")}
        if kind == "finite":
            return {"n": share * self.young} | soft
        return {"n": math.inf} | (soft if kind == "soft" else {})
