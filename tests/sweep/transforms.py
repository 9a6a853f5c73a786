"""A problem in other units, mirrored or turned: its solution is that of the problem, transformed.

``x -> length Q x`` with an orthogonal Q, stresses times ``stress``; then ``u -> length Q u``.
Where u is proportional to the loads, these are multiplied by ``load`` as well.  The mesh is the
same one with its nodes moved, so that the numbers must agree to what the solver promises.
"""

from __future__ import annotations

import copy
import math
import re
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.mesh.domain import Domain

from .case import Study

Value = float | str | None

_COORDINATE = re.compile(r"\b[xyzs]\b")


@dataclass(frozen=True)
class Transform:
    """Q by its ``rows``, each of which has one entry, 1 or -1."""

    rows: tuple[tuple[float, ...], ...]
    length: float = 1.0
    stress: float = 1.0
    load: float = 1.0

    @classmethod
    def random(cls, random: np.random.Generator, study: Study, homogeneous: bool) -> Transform:
        """Other units and a symmetry of a cube, and small loads if the solution is homogeneous."""
        mesh = study["mesh"]
        dim = mesh.get("dim") or (3 if mesh["builder"] == "ball" else 2)
        Q = np.eye(dim)[random.permutation(dim)] * random.choice([-1.0, 1.0], dim)[:, None]
        if mesh.get("axisymmetric"):
            Q = np.eye(dim)
        rows = tuple(tuple(float(q) for q in row) for row in Q)
        sizes = 10.0 ** random.uniform([-3.0, -6.0, -30.0], [3.0, 9.0, 0.0])
        return cls(rows, *map(float, sizes[: 2 + homogeneous]))

    @property
    def matrix(self) -> FloatArray:
        """Q."""
        return np.array(self.rows)

    @property
    def dim(self) -> int:
        return len(self.rows)

    def moved(self, domain: Domain) -> Domain:
        """The domain with its nodes moved, for good; the old one keeps its size."""
        x = domain.mesh.geometry.x
        x[:, : self.dim] = self.places(x[:, : self.dim])
        return replace(domain)

    def places(self, x: FloatArray) -> FloatArray:
        """The positions of the points (k, d) of the problem."""
        return np.asarray(self.length * (x @ self.matrix.T))

    def back(self, u: FloatArray) -> FloatArray:
        """The displacement of the problem from that of the transformed one, both by nodes."""
        turned = u.reshape(-1, self.dim) @ self.matrix
        return np.asarray(turned.ravel() / (self.length * self.load))

    def study(self, given: Study) -> Study:
        """The transformed study, but for its mesh."""
        study = copy.deepcopy(given)
        material, loads, contact = study["material"], study["loads"], study["contact"]
        parts = [material, *material.get("regions", {}).values()]
        for part in parts:
            if "elasticity" in part:
                self._elasticity(part["elasticity"])
            if part.get("locking_limit") is not None:
                part["locking_limit"] = self._value(part["locking_limit"], 1.0)
        for item in material.get("eigenstrain", []):
            for key in {"value", "temperature"} & set(item):
                item[key] = self._strains(item[key])
        for spring in loads.get("springs", []):
            spring["stiffness"] *= self.stress / self.length
            if isinstance(spring.get("along"), list):
                spring["along"] = (self.matrix @ np.array(spring["along"])).tolist()
        for support in loads.get("supports", []):
            if isinstance(support["along"], list):
                support["along"] = (self.matrix @ np.array(support["along"])).tolist()
            support["value"] = self._value(support.get("value", 0.0), self.length)
        force = self.load * self.stress
        if "body_force" in loads:
            loads["body_force"] = self._vector(loads["body_force"], force / self.length)
        for traction in loads.get("tractions", []):
            traction["value"] = self._vector(traction["value"], force)
        for pressure in loads.get("pressures", []):
            pressure["value"] = self._value(pressure["value"], force)
        for condition in loads.get("displacements", []):
            condition["value"] = self._vector(condition["value"], self.length)
        for section in contact if isinstance(contact, list) else [contact]:
            if "gap" in section:
                section["gap"] = self._value(section["gap"], self.length)
            if "foundation" in section:
                around = bool(study["mesh"].get("axisymmetric"))
                self._foundation(section["foundation"], self.dim - 1 + around)
        friction, penalty = study["friction"], study["penalty"]
        friction["coefficient"] = self._value(friction["coefficient"], 1.0)
        lengths = ((friction["smoothing"], "radius"), (friction, "regularisation"))
        for section, key in lengths:
            if section.get(key) is not None:
                section[key] *= self.length
        if "n" in penalty:
            if math.isfinite(penalty["n"]):
                # 1/n, which it is where it is not given, is no length over a stress.
                penalty.setdefault("epsilon", 1.0 / penalty["n"])
            penalty["n"] *= self.stress
        if penalty.get("epsilon") is not None:
            penalty["epsilon"] *= self.length / self.stress
        return study

    def _strains(self, given: Any) -> Any:
        """A number, or normal strains, which are those of the axes where Q turns right angles."""
        if not isinstance(given, list):
            return self._value(given, 1.0)
        places = np.abs(self.matrix).argmax(axis=1)
        return [self._value(given[place], 1.0) for place in places]

    def _elasticity(self, given: Study) -> None:
        if "stiffness" in given:
            turn = _mandel_turn(self.matrix)
            matrix = self.stress * turn @ np.array(given["stiffness"]) @ turn.T
            given["stiffness"] = (0.5 * (matrix + matrix.T)).tolist()
        else:
            for key in {"young", "lambda", "mu"} & set(given):
                given[key] = self._value(given[key], self.stress)

    def _vector(self, values: list[Value], factor: float) -> list[Any]:
        """``factor Q v``; a component that is null stays so."""
        places = np.abs(self.matrix).argmax(axis=1)
        return [
            self._value(values[k], row[k] * factor)
            for k, row in zip(places, self.rows, strict=True)
        ]

    def _value(self, value: Value, factor: float) -> Any:
        """A number or an expression times a factor, its coordinates those of the problem."""
        if value is None:
            return None
        if not isinstance(value, str):
            return factor * value

        def old(match: re.Match[str]) -> str:
            name = match.group()
            if name == "s":
                return f"(s/{self.length!r})"
            column = [row["xyz".index(name)] for row in self.rows]
            parts = [f"{q!r}*{axis}" for q, axis in zip(column, "xyz", strict=False) if q]
            return f"(({' + '.join(parts)})/{self.length!r})"

        return f"{factor!r}*({_COORDINATE.sub(old, value)})"

    def _foundation(self, given: Study, power: int) -> None:
        factors = {"point": self.length, "centre": self.length, "normal": 1.0, "along": 1.0}
        force = self.stress * self.length**power
        for key, body in given.items():
            if key == "expression":
                given[key] = self._value(body, self.length)
            elif key in ("force", "motion"):
                given[key] = self._vector(body, force if key == "force" else self.length)
            else:
                for name in factors.keys() & body.keys():
                    body[name] = self._vector(body[name], factors[name])
                for name in {"radius"} & body.keys():
                    body[name] *= self.length
                for name in {"stiffness"} & body.keys():
                    body[name] *= force / self.length
        if "cylinder" in given and self.dim == 3:
            body = given["cylinder"]
            body["axis"] = self._vector(body.get("axis", [0.0, 1.0, 0.0]), 1.0)


def _mandel_turn(Q: FloatArray) -> FloatArray:
    """The matrix of ``e -> Q e Q'`` for vectors in the order of a study file."""
    dim = len(Q)
    shears = list(reversed(list(combinations(range(dim), 2))))
    pairs = [(i, i) for i in range(dim)] + shears
    turn = np.zeros((len(pairs), len(pairs)))
    for column, (i, j) in enumerate(pairs):
        tensor = np.zeros((dim, dim))
        tensor[i, j] = tensor[j, i] = 1.0 if i == j else math.sqrt(0.5)
        turned = Q @ tensor @ Q.T
        turn[:, column] = [turned[k, m] * (1.0 if k == m else math.sqrt(2.0)) for k, m in pairs]
    return turn
