"""One problem of the sweep: a study as plain data, and known facts about its solution."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Random = np.random.Generator
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
    ``told`` are words of the message of a refusal, or of a warning, that are right where the mesh
    misses something, and ``band`` the place, half of the width and the size of a pressure on top.
    """

    admissible: bool | None = None
    touches: bool | None = None
    translation: tuple[float, ...] | None = None
    homogeneous: bool = False
    refused: str | None = None
    unique: bool | None = None
    other: tuple[float, ...] | None = None
    slip: tuple[float, ...] | None = None
    told: tuple[str, ...] = ()
    band: tuple[float, float, float] | None = None

    @property
    def messages(self) -> tuple[str, ...]:
        """Parts of the messages of refusals that are right."""
        return self.told if self.refused is None else (self.refused, *self.told)


@dataclass(frozen=True)
class Case:
    """A study with its truth.

    With ``verge`` the prescribed displacements are multiplied, before the solve, by this share of
    the largest factor that the mesh admits.  ``twin`` is the same process in other units, with a
    modulus of 1.  A problem of pairs has its features in ``row``.
    """

    study: Study
    truth: Truth = field(default_factory=Truth)
    verge: float | None = None
    twin: Study | None = None
    row: str = ""


Family = Callable[[Random], Case]
FAMILIES: dict[str, Family] = {}


def family(function: Family) -> Family:
    """Register a family under the name of its function."""
    FAMILIES[function.__name__] = function
    return function


def chance(random: Random, share: float = 0.5) -> bool:
    return bool(random.random() < share)


def pick(random: Random, choices: Sequence[Any]) -> Any:
    return choices[int(random.integers(len(choices)))]


def between(random: Random, low: float, high: float) -> float:
    return float(f"{random.uniform(low, high):.5g}")


def decades(random: Random, low: float, high: float) -> float:
    """``10^x`` for x between two exponents."""
    return float(f"{10.0 ** random.uniform(low, high):.4g}")


def vector(random: Random, dim: int, size: float) -> list[float]:
    return [float(f"{size * x:.6g}") for x in random.uniform(-1.0, 1.0, dim)]


def downwards(random: Random, dim: int, size: float) -> list[float]:
    """A random vector whose last component presses down."""
    *along, down = vector(random, dim, size)
    return [*along, -abs(down) - 0.1 * size]


def down(dim: int, size: float) -> list[float]:
    return [0.0] * (dim - 1) + [-size]


def clamp(dim: int, on: Any = "left") -> Study:
    return {"on": on, "value": [0.0] * dim}


def unit_block(random: Random, dim: int, fine: bool = False) -> Study:
    """The unit block, of some tens to some hundreds of cells."""
    sizes = {2: [0.25, 0.2, 0.15], 3: [0.5, 0.4, 0.35]}[dim]
    h = sizes[-1] if fine else pick(random, sizes)
    return _block([1.0] * dim, h, chance(random))


def long_block(random: Random, size: Sequence[float], h: float) -> Study:
    return _block(list(size), h, chance(random))


def _block(size: list[float], h: float, structured: bool) -> Study:
    return {
        "builder": "block",
        "dim": len(size),
        "size": size,
        "h": h,
        "structured": structured,
    }


def some_limit(random: Random) -> float:
    return math.inf if chance(random, 0.3) else decades(random, -3.5, -1.0)


def strain_size(limit: float) -> float:
    """The size of strains that make a problem with this limit interesting."""
    return limit if math.isfinite(limit) else USUAL_STRAIN


def some_friction(random: Random) -> float:
    return pick(random, [0.0, 0.2, 0.3, 0.5, 0.8, 1.0])


def some_kernel(random: Random, radius: float = 0.3) -> Study:
    return {"kernel": pick(random, ["convolution", "helmholtz", "none"]), "radius": radius}


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


def held_and_pressed(
    random: Random, dim: int, stress: float, on: str = "top", **more: Any
) -> Study:
    """Loads of a body that is clamped on the left and pressed down on a side."""
    loads: Study = {
        "tractions": [{"on": on, "value": downwards(random, dim, stress)}],
        "displacements": [clamp(dim)],
    }
    if chance(random, 0.3):
        loads["body_force"] = vector(random, dim, 0.5 * stress)
    return loads | more
