"""Sets of strains, one of each kind, and the material that has them."""

from __future__ import annotations

from typing import Any

ELASTIC = {"young": 1.0, "poisson": 0.3}
SEVERAL: list[dict[str, Any]] = [
    {"norm": "strain", "at_most": 0.02},
    {"norm": "deviator", "at_most": "0.016 + 0.002*x"},
    {"norm": "volume", "at_least": "-0.008 - 0.001*y", "at_most": 0.006},
    {"norm": "direction", "along": ["cos(x)", "sin(x)"], "at_most": 0.007},
    {"norm": "weighted", "matrix": [[2, 0, 0.2], [0, 1, 0], ["0.1*x", 0, 1.5]], "at_most": 0.03},
]


def material(*limits: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"elasticity": ELASTIC, "locking": list(limits), **more}
