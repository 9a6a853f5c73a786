"""A rubber strip that a plate presses into a groove, with two contacts, on a coarse mesh."""

from __future__ import annotations

from typing import Any

from contact_locking import Parameters
from contact_locking.study_file import from_mapping

_GROOVE = [[25, 0], [14, 0], [13, -1.5], [7, -1.5], [6, 0], [-5, 0]]
_RUBBER = {"elasticity": {"young": 5.0, "poisson": 0.45}, "locking_limit": 0.2}


def seal(motion: str = "-0.8*t", **sections: Any) -> Parameters:
    """The strip, 8 high, under a plate with this motion downwards."""
    plate = {"half_space": {"point": [0, 8], "normal": [0, -1]}, "motion": [0, motion]}
    return from_mapping(
        {
            "mesh": {"builder": "block", "size": [20, 8], "h": 2.0},
            "material": _RUBBER,
            "contact": [
                {"on": "bottom", "foundation": {"polyline": _GROOVE}},
                {"on": "top", "name": "plate", "foundation": plate},
            ],
            "friction": {"coefficient": 0.3},
            "steps": {"to": 1, "count": 2},
            **sections,
        }
    )


def two_bodies(on: str, against: str) -> Parameters:
    """The strip under a stiff holder that is pressed down, with the contact of the bodies."""
    return from_mapping(
        {
            "mesh": {"builder": "stack", "size": [20, 8], "upper": [26, 6], "h": 2.0},
            "material": {
                "regions": {
                    "lower": _RUBBER,
                    "upper": {"elasticity": {"young": 2000, "poisson": 0.4}},
                }
            },
            "loads": {"displacements": [{"on": "top", "value": [0, "-0.8*t"]}]},
            "contact": [
                {"on": "bottom", "foundation": {"polyline": _GROOVE}},
                {"on": on, "against": against},
            ],
            "friction": {"coefficient": 0.3},
            "steps": {"to": 1, "count": 1},
        }
    )
