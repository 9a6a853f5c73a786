"""Bodies and loads of which studies are made that a first solver got wrong."""

from __future__ import annotations

from typing import Any

from sweep.case import Study, Truth, clamp


def block(*size: float, h: float, structured: bool = False) -> Study:
    return {
        "builder": "block",
        "dim": len(size),
        "size": list(size),
        "h": h,
        "structured": structured,
    }


def square(h: float = 0.25) -> Study:
    return block(1.0, 1.0, h=h)


def cube(h: float = 0.35) -> Study:
    return block(1.0, 1.0, 1.0, h=h)


def inclusion(h: float, young: float, **more: Any) -> tuple[Study, Study]:
    """A mesh, and the regions of its material."""
    regions = {"inclusion": {"elasticity": {"young": young, "poisson": 0.3}, **more}}
    return {"builder": "inclusion", "dim": 2, "h": h}, regions


def pulled(*traction: float, on: str = "top", **more: Any) -> Study:
    """Clamped on the left and loaded by a traction."""
    return {
        "tractions": [{"on": on, "value": list(traction)}],
        "displacements": [clamp(len(traction))],
        **more,
    }


def moved(*value: float, on: str = "top") -> Study:
    return {"displacements": [{"on": on, "value": list(value)}]}


def ends(*value: float) -> Study:
    """Clamped on the left, the right side moved."""
    return {"displacements": [clamp(len(value)), {"on": "right", "value": list(value)}]}


def smoothed(kernel: str, radius: float = 0.3) -> Study:
    return {"kernel": kernel, "radius": radius}


def rollers(pressure: float, *sides: str) -> Study:
    return {
        "displacements": [{"on": list(sides), "value": [0.0, None]}],
        "tractions": [{"on": "top", "value": [0.0, -pressure]}],
    }


def with_regions(data: Study, regions: Study) -> Study:
    data["material"]["regions"] = regions
    return data


#: Some field is within limit and gap.
HELD = Truth(admissible=True)
#: The body touches its foundation, too.
CARRIED = Truth(admissible=True, touches=True)
