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
class Placement:
    """The surroundings of a foundation: dimension, ranks, clock; and the warnings about it.

    ``key`` is the key of the foundation in the study file.
    """

    dim: int
    comm: MPI.Intracomm
    clock: Clock
    key: str
    warnings: list[str] = field(default_factory=list)


def _half_space(given: rigid_body.HalfSpace, placement: Placement) -> Foundation:
    return HalfSpace(given.point, given.normal)


def _sphere(given: rigid_body.Sphere, placement: Placement) -> Foundation:
    return Sphere(given.centre, given.radius)


def _cylinder(given: rigid_body.Cylinder, placement: Placement) -> Foundation:
    if placement.dim == 2:
        return Sphere(given.centre, given.radius)
    return Cylinder(given.centre, given.radius, given.axis or (0.0, 1.0, 0.0))


def _level_set(given: float | str, placement: Placement) -> Foundation:
    axes = AXES[: placement.dim]
    expression = parse(given, (*axes, TIME), tables=placement.clock.tables)

    def function(x: FloatArray) -> tuple[FloatArray, FloatArray]:
        variables = {**dict(zip(axes, x, strict=True)), TIME: placement.clock.now}
        return value_and_gradient(expression, axes, variables)

    return LevelSet(function)


def _polyline(given: tuple[tuple[float, ...], ...] | str, placement: Placement) -> Foundation:
    if isinstance(given, str):
        file = Path(given)
        corners = on_root(placement.comm, lambda: read_corners(file, rigid_body.MOST_CORNERS))
    else:
        corners = np.array(given, dtype=float)
    kept = np.append(True, np.any(np.diff(corners, axis=0) != 0.0, axis=1))
    if kept.sum() < 2:
        raise InputError("has no segment: give at least two corners at different places")
    if not kept.all():
        placement.warnings.append(
            f"{placement.key}.polyline: {(~kept).sum()} corners stand twice in a row"
        )
    line = Polyline(corners[kept])
    if (crossing := line.crossing()) is not None:
        first, second = crossing
        raise InputError(
            f"crosses or touches itself: segments {first + 1} and {second + 1} meet, so that it "
            "has no two sides"
        )
    return line


def _surface(given: rigid_body.Surface, placement: Placement) -> Foundation:
    shift = given.shift or (0.0, 0.0, 0.0)
    found = on_root(
        placement.comm,
        lambda: read_surface(Path(given.file), given.scale, shift, given.turned, given.spacing),
    )
    placement.warnings.extend(f"{placement.key}.surface: {text}" for text in found.warnings)
    return TriangulatedSurface(found.points, found.triangles)


#: For each shape of a section ``foundation``: the foundation of its section or value.
FOUNDATIONS: dict[str, Callable[[Any, Placement], Foundation]] = {
    "half_space": _half_space,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "expression": _level_set,
    "polyline": _polyline,
    "surface": _surface,
}


def build(shape: str, given: Any, placement: Placement) -> Foundation:
    """The foundation of a shape; collective.  Raises InputError with the key of the shape."""
    try:
        return FOUNDATIONS[shape](given, placement)
    except InputError as error:
        # A file may be read as that of a mesh, so that its key is replaced.
        raise InputError(str(error), f"{placement.key}.{shape}") from error
