"""A ring whose hole is moved, all of whose outside may touch a foundation below."""

from __future__ import annotations

from typing import Any

from contact_locking import Parameters
from contact_locking.study_file import from_mapping


def floor(**motion: Any) -> dict[str, Any]:
    """The half space on which a ring stands."""
    return {"half_space": {"point": [0.0, -2.0], "normal": [0.0, 1.0]}} | motion


def ring(way: list[Any], foundation: dict[str, Any], **changes: Any) -> Parameters:
    """The hole is moved by ``way``."""
    return from_mapping(
        {
            "mesh": {"builder": "annulus", "h": 0.3},
            "material": {"locking_limit": 0.06},
            "loads": {"displacements": [{"on": "inner", "value": way}]},
            "contact": {"on": "outer", "foundation": foundation},
            "friction": {"coefficient": 0.3},
            "output": {"picture": False},
        }
        | changes
    )
