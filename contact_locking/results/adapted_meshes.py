"""The meshes of a run with adapted meshes, as arrays and as a file, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError


@dataclass(frozen=True)
class AdaptedMesh:
    """The triangles (t, 3) of a mesh in 2D, or of its surface in 3D, with points x (v, d).

    ``marked`` (t,) tells the triangles of the cells that were refined for the next mesh.
    """

    x: FloatArray
    triangles: IntArray
    marked: BoolArray

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])

    @classmethod
    def of(cls, points: FloatArray, cells: IntArray) -> AdaptedMesh:
        """The picture of a mesh with points (m, d) and cells (k, d + 1), without marks.

        The triangles are in the order of the cells in 2D, and in 3D as :func:`surface` has them.
        """
        triangles = cells if points.shape[1] == 2 else surface(cells)[0]
        return cls(points, triangles, np.zeros(len(triangles), dtype=bool))

    def with_marks(self, cells: IntArray, marked: BoolArray) -> AdaptedMesh:
        """The same picture with the marked cells (k,) of all cells (k, d + 1)."""
        of = marked if self.dim == 2 else marked[surface(cells)[1]]
        return replace(self, marked=of)


def surface(cells: IntArray) -> tuple[IntArray, IntArray]:
    """The exterior facets (f, 3) of tetrahedra (k, 4), and the cell (f,) of each."""
    rows = np.concatenate([np.delete(cells, i, axis=1) for i in range(4)])
    _, first, count = np.unique(
        np.sort(rows, axis=1), axis=0, return_index=True, return_counts=True
    )
    outer = np.sort(first[count == 1])
    return rows[outer], outer % len(cells)


def save(meshes: Sequence[AdaptedMesh], path: Path) -> None:
    """Write the meshes, if there are any, into one file, without Python's pickle."""
    if not meshes:
        return
    arrays = {
        f"{name}_{number}": getattr(mesh, name)
        for number, mesh in enumerate(meshes)
        for name in ("x", "triangles", "marked")
    }
    with path.open("wb") as stream:
        np.savez_compressed(stream, count=np.array(len(meshes)), **arrays)


def load(path: Path) -> list[AdaptedMesh]:
    """The meshes in a file of :func:`save`.  Raises InputError if the file is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            return [
                AdaptedMesh(*(file[f"{name}_{number}"] for name in ("x", "triangles", "marked")))
                for number in range(int(file["count"]))
            ]
    except (OSError, ValueError, KeyError, TypeError, EOFError) as error:
        raise InputError(f"{path}: is damaged: {error}") from error
