"""The surface of a foundation from a file of triangles or heights: checked, each corner once.

A file may come from anybody: its size is checked before its content is read, and the numbers of a
binary file are read as an array whose length the size of the file has confirmed.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.files import require_size
from contact_locking.findings import Finding
from contact_locking.mesh.data import keys, point_words

ENDINGS = (".csv", ".npy")
# As many heights are two million triangles.
_MOST = 1_000_000
# A binary file has a head of 80 bytes and the number of triangles, and then 50 bytes for each:
# normal, three corners, and two bytes that nobody uses.
_HEAD, _RECORD = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
# A triangle is degenerate if its height is below this share of its longest edge.
_FLAT = 1e-9
# Coordinates beyond are no lengths in any unit.
_LARGEST = 1e50

#: Corners (m, 3), triangles (n, 3) as numbers of corners, and findings.
Surface = tuple[FloatArray, IntArray, list[Finding]]


def read_surface(
    path: Path,
    scale: float = 1.0,
    shift: Sequence[float] = (0.0, 0.0, 0.0),
    turned: bool = False,
    spacing: Sequence[float] | None = None,
) -> Surface:
    """The triangles of a file, at ``scale`` times their coordinates plus ``shift``.

    The file is an STL file, or a height map with a ``spacing`` (`read_heights`).
    With ``turned`` the other side is outside.  Raises InputError for a file that cannot be read,
    and for triangles that are not the surface of a foundation (`checked`).
    """
    require_size(path)
    is_grid = path.suffix.lower() in ENDINGS
    if is_grid and spacing is None:
        raise InputError(f"{path} has heights: give spacing: [dx, dy], the distances of its grid")
    if is_grid and spacing is not None:
        points, triangles = read_heights(path, spacing)
    elif spacing is not None:
        raise InputError(f"{path} has triangles; spacing is for a height map, .csv or .npy")
    else:
        corners = read_stl(path)
        points, triangles = corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)
    points = scale * points + np.asarray(shift)
    if not np.isfinite(points).all() or np.abs(points).max() > _LARGEST:
        raise InputError(f"{path} has coordinates that are not finite, or too large")
    triangles = triangles[:, ::-1] if turned else triangles
    return (points, triangles, []) if is_grid else checked(points[triangles], str(path))


def checked(corners: FloatArray, origin: str) -> Surface:
    """The surface of triangles with the corners (n, 3, 3).

    Degenerate triangles and copies of triangles are left out.  Raises InputError if nothing is
    left, for an edge of more than two triangles, at which no side is outside, and for neighbours
    that look to different sides.
    """
    findings = []
    edges = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    flat = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) <= _FLAT * longest**2
    if flat.all():
        raise InputError(f"{origin} holds degenerate triangles only, which have no area")
    if flat.any():
        findings.append(Finding("foundation.degenerate", file=origin, count=int(flat.sum())))
    corners = corners[~flat].reshape(-1, 3)
    points, numbers = np.unique(corners, axis=0, return_inverse=True)
    triangles: IntArray = numbers.reshape(-1, 3)
    first = np.unique(keys(np.sort(triangles, axis=1), len(points)), return_index=True)[1]
    if copies := len(triangles) - len(first):
        findings.append(Finding("foundation.copies", file=origin, count=copies))
        triangles = triangles[np.sort(first)]
    sides = triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, first, counts = np.unique(
        keys(np.sort(sides, axis=1), len(points)), return_index=True, return_counts=True
    )
    if (counts > 2).any():
        a, b = points[sides[first[np.argmax(counts)]]]
        raise InputError(
            f"{origin}: {counts.max()} triangles share the edge from {point_words(a)} to "
            f"{point_words(b)}, and a surface has two sides only where two do; leave out inner "
            "walls and doubled parts"
        )
    # Of two triangles that look to one side, one runs along the common edge and one against it.
    if len(np.unique(keys(sides, len(points)))) < len(sides):
        raise InputError(
            f"{origin}: neighbouring triangles face different sides, so that the outside is "
            "undefined; let all of them run counterclockwise seen from the body (in MeshLab: "
            "Re-Orient all faces coherently)"
        )
    if rim := int(np.sum(counts == 1)):
        findings.append(Finding("foundation.open", file=origin, count=rim))
    return points, triangles, findings


def read_stl(path: Path) -> FloatArray:
    """The corners (n, 3, 3) of the n triangles of an STL file, not checked yet.

    Raises InputError for a file that is no STL file, is cut off, or holds no triangles.
    """
    require_size(path)
    content = path.read_bytes()
    count = int.from_bytes(content[80:_HEAD], "little") if len(content) >= _HEAD else -1
    # A binary file may begin like one in text form, so that its length decides.
    if count >= 0 and len(content) == _HEAD + _RECORD.itemsize * count:
        records = np.frombuffer(content, dtype=_RECORD, offset=_HEAD)
        corners: FloatArray = records["corners"].astype(float)
    elif content[:_HEAD].lstrip().lower().startswith(b"solid"):
        # Every corner stands behind the word vertex; names of solids stand in lines of their own.
        lines = [line.split() for line in content.lower().splitlines()]
        numbers = [line[1:] for line in lines if line and line[0] == b"vertex"]
        facets = sum(1 for line in lines if line and line[0] == b"endfacet")
        if len(numbers) != 3 * facets or b"endsolid" not in content[-1000:].lower():
            raise InputError(
                f"{path} is cut off: as an STL file in text form it has {len(numbers)} corners of "
                f"{facets} whole triangles"
            )
        try:
            corners = np.array(numbers, dtype=float).reshape(-1, 3, 3)
        except ValueError:
            message = "cannot be read as an STL file: a line with vertex has no three numbers"
            raise InputError(f"{path} {message}") from None
    else:
        raise InputError(
            f"{path} is cut off, or no STL file, which begins with solid or is binary; Gmsh writes "
            "its meshes as .stl, too"
        )
    if not len(corners):
        raise InputError(f"{path} holds no triangles")
    return corners


def read_heights(path: Path, spacing: Sequence[float]) -> tuple[FloatArray, IntArray]:
    """The corners (m, 3), and the triangles (n, 3) that run counterclockwise seen from above.

    Row j and column i of the file are the height at (i dx, j dy), with the ``spacing`` (dx, dy).
    Each rectangle of the grid is two triangles.  Raises InputError for a file without such numbers.
    """
    heights = _numbers(path)
    if heights.size > _MOST:
        raise InputError(f"{path} has more than {_MOST} heights; use a coarser grid")
    if min(heights.shape) < 2:
        shape = " by ".join(map(str, heights.shape))
        raise InputError(f"{path} is not a surface: its grid has {shape} heights")
    x, y = (step * np.arange(n) for step, n in zip(spacing, heights.T.shape, strict=True))
    along, across = np.meshgrid(x, y)
    corners = np.column_stack([along.ravel(), across.ravel(), heights.ravel()])
    number = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return corners, triangles


def read_corners(path: Path, most: int) -> FloatArray:
    """The corners (m, 2) in the first two columns of a CSV file.

    Raises InputError for a file with other things than a heading and numbers, or with too many.
    """
    numbers = _numbers(path)
    if numbers.shape[1] < 2 or len(numbers) > most:
        raise InputError(f"{path} has no two columns x, y of at most {most} corners")
    return numbers[:, :2]


def _numbers(path: Path) -> FloatArray:
    """The rows of finite numbers in a CSV or NumPy file, without a heading."""
    require_size(path)
    try:
        if path.suffix.lower() == ".npy":
            numbers = np.load(path, allow_pickle=False)
        else:
            try:
                numbers = _rows(path, 0)
            except ValueError:
                numbers = _rows(path, 1)
        numbers = np.asarray(numbers).astype(float, casting="same_kind")
    except (ValueError, TypeError, EOFError, OSError) as error:
        raise InputError(f"{path} cannot be read as rows of numbers: {error}") from None
    if numbers.ndim != 2:
        raise InputError(f"{path} has {numbers.ndim} axes; a table has 2")
    is_finite = np.isfinite(numbers)
    if not is_finite.all():
        row, count = int(np.argmin(is_finite.all(axis=1))) + 1, np.count_nonzero(~is_finite)
        raise InputError(f"{path}: {count} of its numbers are not finite, the first in row {row}")
    return numbers


def _rows(path: Path, heading: int) -> FloatArray:
    with warnings.catch_warnings():
        # A file without rows is judged by its size.
        warnings.simplefilter("ignore")
        # A spreadsheet begins a file with a byte order mark.
        return np.loadtxt(path, delimiter=",", skiprows=heading, ndmin=2, encoding="utf-8-sig")
