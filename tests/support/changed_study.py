"""A study file of a small block with some keys changed."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

GOOD: dict[str, Any] = {
    "mesh": {"builder": "block", "dim": 2, "size": [1.0, 1.0], "h": 0.25},
    "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
    "loads": {
        "body_force": [0.0, 0.0],
        "tractions": [{"on": "top", "value": [0.03, -0.05]}],
        "displacements": [{"on": "left", "value": [0.0, 0.0]}],
    },
    "contact": {"on": "bottom"},
    "friction": {"coefficient": 0.3, "smoothing": {"kernel": "convolution", "radius": 0.5}},
    "penalty": {"n": 100.0},
}


def changed(folder: Path, changes: dict[str, Any]) -> Path:
    data = copy.deepcopy(GOOD)
    for key, value in changes.items():
        *path, last = key.split(".")
        place: Any = data
        for name in path:
            place = place[int(name)] if name.isdigit() else place.setdefault(name, {})
        place[last] = value
    file = folder / "study.yml"
    with file.open("w") as stream:
        YAML(typ="safe").dump(data, stream)
    return file
