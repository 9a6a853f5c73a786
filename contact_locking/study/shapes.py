"""The shapes of rigid foundations, from the sections of the study file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import AXES, FloatArray
from contact_locking.errors import InputError
from contact_locking.expressions import TIME, parse
from contact_locking.expressions.gradient import value_and_gradient
from contact_locking.fields.clock import Clock
from contact_locking.laws.foundation import Cylinder, Foundation, HalfSpace, Sphere
from contact_locking.laws.level_set import LevelSet
from contact_locking.laws.polyline import Polyline
from contact_locking.laws.triangulated import TriangulatedSurface
from contact_locking.mesh.file.tool_surface import read_corners, read_surface
from contact_locking.parallel import on_root
from contact_locking.study_file.parameters import rigid_body


@dataclass
class Site:
    """Where a foundation stands: the dimension, the ranks, the clock, and what there is to warn of.

    ``key`` is the key of the foundation in the study file.
    """

    dim: int
    comm: MPI.Intracomm
    clock: Clock
    key: str
    warnings: list[str] = field(default_factory=list)


def _half_space(given: rigid_body.HalfSpace, site: Site) -> Foundation:
    return HalfSpace(given.point, given.normal)


def _sphere(given: rigid_body.Sphere, site: Site) -> Foundation:
    return Sphere(given.centre, given.radius)


def _cylinder(given: rigid_body.Cylinder, site: Site) -> Foundation:
    if site.dim == 2:
        return Sphere(given.centre, given.radius)
    return Cylinder(given.centre, given.radius, given.axis or (0.0, 1.0, 0.0))


def _level_set(given: float | str, site: Site) -> Foundation:
    axes = AXES[: site.dim]
    expression = parse(given, (*axes, TIME), tables=site.clock.tables)

    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        variables = {**dict(zip(axes, x, strict=True)), TIME: site.clock.now}
        return value_and_gradient(expression, axes, variables)

    return LevelSet(function)


def _polyline(given: tuple[tuple[float, ...], ...] | str, site: Site) -> Foundation:
    if isinstance(given, str):
        file = Path(given)
        corners = on_root(site.comm, lambda: read_corners(file, rigid_body.MOST_CORNERS))
    else:
        corners = np.array(given, dtype=float)
    kept = np.append(True, np.any(np.diff(corners, axis=0) != 0.0, axis=1))
    if kept.sum() < 2:
        raise InputError("has no segment: give at least two corners at different places")
    if not kept.all():
        site.warnings.append(f"{site.key}.polyline: {(~kept).sum()} corners stand twice in a row")
    line = Polyline(corners[kept])
    if (crossing := line.crossing()) is not None:
        first, second = crossing
        raise InputError(
            f"crosses or touches itself: segments {first + 1} and {second + 1} meet, so that it "
            "has no two sides"
        )
    return line


def _surface(given: rigid_body.Surface, site: Site) -> Foundation:
    shift = given.shift or (0.0, 0.0, 0.0)
    found = on_root(
        site.comm, lambda: read_surface(Path(given.file), given.scale, shift, given.turned)
    )
    site.warnings += [f"{site.key}.surface: {text}" for text in found.warnings]
    return TriangulatedSurface(found.points, found.triangles)


#: For each shape of a section ``foundation``: the foundation of its section or value at a site.
FOUNDATIONS: dict[str, Callable[[Any, Site], Foundation]] = {
    "half_space": _half_space,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "expression": _level_set,
    "polyline": _polyline,
    "surface": _surface,
}


def build(shape: str, given: Any, site: Site) -> Foundation:
    """The foundation of a shape; collective.  Raises InputError with the key of the shape."""
    try:
        return FOUNDATIONS[shape](given, site)
    except InputError as error:
        # A file may be read as that of a mesh, so that its key is replaced.
        raise InputError(str(error), f"{site.key}.{shape}") from error
