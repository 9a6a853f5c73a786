"""Families of what is narrower than a cell: tools between the nodes, loads and data."""

from __future__ import annotations

from .case import Case, Random, Study, Truth, between, chance, decades, pick, some_kernel, study
from .case import family as registered

_TOOL = ("between the nodes", "that the nodes miss")
_LOAD = ("changes too sharply", "its resultant is uncertain", "is zero at all points")
_DATA = ("where the mesh sees it", "changes from")


def _mesh(random: Random, h: float) -> Study:
    size = [2.0, 1.0]
    return {"builder": "block", "dim": 2, "size": size, "h": h, "structured": chance(random)}


@registered
def between_nodes(random: Random) -> Case:
    """A roller of about the size of a facet, pressed into a clamped block wherever it is."""
    h = pick(random, [0.2, 0.25, 0.34])
    radius = h * decades(random, -0.6, 0.4)
    depth = min(radius, h) * between(random, 0.01, 0.4)
    centre = [between(random, 0.3, 1.7), 1.0 + radius - depth]
    data = study(
        _mesh(random, h),
        {"displacements": [{"on": "bottom", "value": [0.0, 0.0]}]},
        gap={"cylinder": {"centre": centre, "radius": radius}},
        on="top",
        friction=pick(random, [0.0, 0.3]),
        smoothing=some_kernel(random, 2.5 * h),
    )
    return Case(data, Truth(told=_TOOL))


@registered
def narrow(random: Random) -> Case:
    """A pressure, a limit or a coefficient that changes within a cell, down to thin spots."""
    h = pick(random, [0.2, 0.25, 0.34])
    centre, half = between(random, 0.2, 1.8), h * decades(random, -2.5, 0.3)
    inside = f"abs(x - {centre}) < {half}"
    what = pick(random, ["load", "limit", "friction"])
    size = decades(random, -4.0, -2.0)
    pressure = between(random, 0.1, 1.0) * size / min(half, 1.0)
    loads: Study = {"displacements": [{"on": "left", "value": [0.0, 0.0]}]}
    limit: float | str = 1.0
    friction: float | str = pick(random, [0.0, 0.3])
    told: tuple[str, ...] = _DATA
    band = None
    if what == "load":
        loads["tractions"] = [{"on": "top", "value": [0.0, f"-{pressure} if {inside} else 0"]}]
        told, band = _LOAD, (centre, half, pressure)
    else:
        loads["tractions"] = [{"on": "top", "value": [0.3 * size, -size]}]
        # Thinner than this a spot may fall between all points that are looked at.
        half = max(half, 0.02 * h)
        inside = f"abs(x - {centre}) < {half}"
        if what == "limit":
            limit = f"{size} if {inside} else {5.0 * size}"
        else:
            friction = f"0.6 if {inside} else 0.1"
    data = study(
        _mesh(random, h),
        loads,
        limit=limit,
        friction=friction,
        smoothing=some_kernel(random, 2.5 * h),
    )
    return Case(data, Truth(told=told, band=band))
