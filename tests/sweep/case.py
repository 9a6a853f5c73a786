"""One problem of the sweep: a study as plain data, and known facts about its solution."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Study = dict[str, Any]

# Where nothing locks, strains of this size keep a problem in the range of small strains.
USUAL_STRAIN = 0.02


@dataclass(frozen=True)
class Truth:
    """Facts about a solution that are known without a solve; None for an unknown fact.

    ``admissible`` says that an admissible displacement exists, so that the verdict "infeasible"
    would be wrong; if ``admissible`` is False, this verdict is right.  ``touches`` says whether
    there is a contact force.  ``translation`` is the displacement of all nodes.  ``homogeneous``
    says that the displacement scales with the loads.  ``refused`` is a part of the message of a
    refusal that is right; then a solution is wrong, also one that the judge finds no fault with: in
    a displacement that is large enough, rounding hides that forces do not balance.  ``unique`` says
    whether another displacement solves the problem; ``other`` is a translation to such a solution,
    or its opposite.  ``slip`` (d - 1,) is the slip along the axes at all nodes of Gamma_C.
    ``maybe`` is a part of the message of a refusal that is right where there is no solution.
    ``told`` are words of the message of a refusal, or of a warning, that are right where the mesh
    misses something, and ``band`` the place, half of the width and the size of a pressure on top.
    """

    admissible: bool | None = None
    touches: bool | None = None
    translation: tuple[float, ...] | None = None
    homogeneous: bool = False
    refused: str | None = None
    maybe: str | None = None
    unique: bool | None = None
    other: tuple[float, ...] | None = None
    slip: tuple[float, ...] | None = None
    told: tuple[str, ...] = ()
    band: tuple[float, float, float] | None = None

    @property
    def messages(self) -> tuple[str, ...]:
        """Parts of the messages of refusals that are right."""
        return (*filter(None, (self.refused, self.maybe)), *self.told)


@dataclass(frozen=True)
class Case:
    """A study with its truth.

    With ``verge`` the prescribed displacements are multiplied, before the solve, by this share of
    the largest factor that the mesh admits.  A problem of pairs has its features in ``row``.
    """

    study: Study
    truth: Truth = field(default_factory=Truth)
    verge: float | None = None
    row: str = ""


class Random(np.random.Generator):
    """Random numbers, and random parts of a study."""

    @classmethod
    def of(cls, *seed: int) -> Random:
        return cls(np.random.PCG64(seed))

    def chance(self, share: float = 0.5) -> bool:
        return bool(self.random() < share)

    def pick(self, choices: Sequence[Any]) -> Any:
        return choices[int(self.integers(len(choices)))]

    def between(self, low: float, high: float) -> float:
        return float(f"{self.uniform(low, high):.5g}")

    def decades(self, low: float, high: float) -> float:
        """``10^x`` for x between two exponents."""
        return float(f"{10.0 ** self.uniform(low, high):.4g}")

    def vector(self, dim: int, size: float) -> list[float]:
        return [float(f"{size * x:.6g}") for x in self.uniform(-1.0, 1.0, dim)]

    def downwards(self, dim: int, size: float) -> list[float]:
        """A vector whose last component presses down."""
        *along, down = self.vector(dim, size)
        return [*along, -abs(down) - 0.1 * size]

    def unit_block(self, dim: int, fine: bool = False) -> Study:
        """The unit block, of some tens to some hundreds of cells."""
        sizes = {2: [0.25, 0.2, 0.15], 3: [0.5, 0.4, 0.35]}[dim]
        return self.block([1.0] * dim, sizes[-1] if fine else self.pick(sizes))

    def block(self, size: Sequence[float], h: float) -> Study:
        mesh: Study = {"builder": "block", "dim": len(size), "size": list(size), "h": h}
        return mesh | {"structured": self.chance()}

    def limit(self) -> float:
        return math.inf if self.chance(0.3) else self.decades(-3.5, -1.0)

    def body(self) -> tuple[int, float, float]:
        """The dimension, the limit, and the size of strains that make the limit interesting."""
        dim, limit = self.pick([2, 2, 3]), self.limit()
        return dim, limit, strain_size(limit)

    def friction(self) -> float:
        return float(self.pick([0.0, 0.2, 0.3, 0.5, 0.8, 1.0]))

    def kernel(self, radius: float = 0.3) -> Study:
        return {"kernel": self.pick(["convolution", "helmholtz", "none"]), "radius": radius}

    def rubbing(self, mesh: Study, loads: Study, radius: Any = 0.3, **more: Any) -> Study:
        """A study with friction: coefficient, radius (of several) and kernel are drawn last."""
        friction = self.friction()
        smoothing = self.kernel(self.pick(radius) if isinstance(radius, list) else radius)
        return study(mesh, loads, friction=friction, smoothing=smoothing, **more)

    def held_and_pressed(self, dim: int, stress: float, on: str = "top") -> Study:
        """Loads of a body that is clamped on the left and pressed down on a side."""
        loads: Study = {"tractions": [{"on": on, "value": self.downwards(dim, stress)}]}
        loads["displacements"] = [clamp(dim)]
        if self.chance(0.3):
            loads["body_force"] = self.vector(dim, 0.5 * stress)
        return loads


Family = Callable[[Random], Case]
FAMILIES: dict[str, Family] = {}


def family(function: Family) -> Family:
    """Register a family under the name of its function."""
    FAMILIES[function.__name__] = function
    return function


def down(dim: int, size: float) -> list[float]:
    return [0.0] * (dim - 1) + [-size]


def clamp(dim: int, on: Any = "left") -> Study:
    return {"on": on, "value": [0.0] * dim}


def strain_size(limit: float) -> float:
    """The size of strains that make a problem with this limit interesting."""
    return limit if math.isfinite(limit) else USUAL_STRAIN


def study(
    mesh: Study,
    loads: Study,
    young: float = 1.0,
    poisson: float = 0.3,
    limit: float | str = math.inf,
    gap: float | str | Study = 0.0,
    on: Any = "bottom",
    friction: float | str = 0.0,
    smoothing: Study | None = None,
    penalty: Study | None = None,
) -> Study:
    """A study file as plain data; a ``gap`` that is a mapping is a foundation."""
    key = "foundation" if isinstance(gap, dict) else "gap"
    return {
        "mesh": mesh,
        "material": {
            "elasticity": {"young": young, "poisson": poisson},
            "locking_limit": limit,
        },
        "loads": loads,
        "contact": {"on": on, key: gap},
        "friction": {
            "coefficient": friction,
            "smoothing": smoothing or {"kernel": "convolution", "radius": 0.3},
        },
        "penalty": {"n": math.inf} if penalty is None else penalty,
    }
