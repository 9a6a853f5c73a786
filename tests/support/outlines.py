"""Plane bodies that are drawn by their outlines, as triangles of Gmsh."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from contact_locking.meshes.geometry import empty_model

Place = tuple[float, float]


@dataclass(frozen=True)
class Side:
    """A line, or an arc around ``centre``, from ``start`` to the start of the next side.

    ``names`` are those of its boundary parts, with spaces between them.
    """

    names: str
    start: Place
    centre: Place | None = None


Outlines = Mapping[str, Sequence[Side]]
Size = Callable[[Place], float]


def write_outlines(path: Path, bodies: Outlines, size: Size) -> Path:
    """A mesh file of triangles, of the ``size`` at each place; for one process.

    Bodies share no nodes.
    """
    import gmsh

    with empty_model("outlines") as model:
        geo, parts = model.geo, dict[str, list[int]]()
        faces = {}
        for body, sides in bodies.items():
            tags = {side.start: geo.addPoint(*side.start, 0.0) for side in sides}
            curves = []
            for side, after in zip(sides, [*sides[1:], sides[0]], strict=True):
                start, end = tags[side.start], tags[after.start]
                if side.centre is None:
                    curves.append(geo.addLine(start, end))
                else:
                    curves.append(geo.addCircleArc(start, geo.addPoint(*side.centre, 0.0), end))
                for name in side.names.split():
                    parts.setdefault(name, []).append(curves[-1])
            faces[body] = geo.addPlaneSurface([geo.addCurveLoop(curves)])
        geo.synchronize()
        for name, curves in parts.items():
            model.addPhysicalGroup(1, curves, name=name)
        for name, face in faces.items():
            model.addPhysicalGroup(2, [face], name=name)
        model.mesh.setSizeCallback(lambda dim, tag, x, y, z, before: size((x, y)))
        model.mesh.generate(2)
        gmsh.write(str(path))
    return path


def graded(centres: Sequence[Place], fine: float, coarse: float, near: float, far: float) -> Size:
    """``fine`` up to the distance ``near`` from the nearest centre, ``coarse`` from ``far`` on."""

    def size(place: Place) -> float:
        away = min(math.dist(place, centre) for centre in centres)
        share = min(max((away - near) / (far - near), 0.0), 1.0)
        return fine + share * (coarse - fine)

    return size
