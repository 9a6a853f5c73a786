"""The surface of a foundation from a file of triangles or heights: checked, each corner once.

A file may come from anybody: its size is checked before its content is read, and the numbers of a
binary file are read as an array whose length the size of the file has confirmed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.files.csv_file import number_at, rows_of
from contact_locking.files.readable import require_size
from contact_locking.mesh.file import places
from contact_locking.mesh.file.reader import read_triangles

ENDINGS = (".csv", ".npy")
# As many heights are two million triangles.
_MOST = 1_000_000
# Coordinates of one line of the grid may differ by this share of the length of the grid.
_SAME = 1e-6


def read_heights(path: Path, spacing: Sequence[float] | None) -> tuple[FloatArray, IntArray]:
    """The corners (m, 3), and the triangles (n, 3) that run counterclockwise seen from above.

    With ``spacing`` (2,) the file holds heights: row j and column i are at (i dx, j dy).  Without,
    its rows are x, y, z at all places of a rectangular grid.  Each rectangle of the
    grid is two triangles.  Raises InputError for a file that holds no such numbers.
    """
    numbers = _numbers(path)
    if numbers.size > _MOST * (1 if spacing else 3):
        raise InputError(f"{path} has more than {_MOST} heights; take a coarser grid")
    if not np.isfinite(numbers).all():
        row = int(np.argmax(~np.isfinite(numbers).all(axis=1))) + 1
        count = np.count_nonzero(~np.isfinite(numbers))
        raise InputError(f"{path}: {count} of its numbers are not finite, the first in row {row}")
    if spacing:
        heights = numbers
        x, y = (step * np.arange(n) for step, n in zip(spacing, numbers.T.shape, strict=True))
    else:
        x, y, heights = _of_rows(numbers, path)
    if min(heights.shape) < 2:
        shape = " by ".join(map(str, heights.shape))
        raise InputError(f"{path} is no surface: its grid has {shape} heights")
    along, across = np.meshgrid(x, y)
    corners = np.column_stack([along.ravel(), across.ravel(), heights.ravel()])
    number = np.arange(heights.size).reshape(heights.shape)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return corners, triangles


def _numbers(path: Path) -> FloatArray:
    try:
        if path.suffix.lower() == ".npy":
            found = np.load(path, allow_pickle=False)
        else:
            with path.open(encoding="utf-8-sig") as stream:
                found = np.loadtxt(stream, delimiter=",", skiprows=_heading(path), ndmin=2)
        found = np.asarray(found, dtype=float)
    except (ValueError, TypeError, EOFError, OSError) as error:
        raise InputError(f"{path} cannot be read as rows of numbers: {error}") from None
    if found.ndim != 2:
        raise InputError(f"{path} has {found.ndim} axes; a height map has 2")
    return found


def _heading(path: Path) -> int:
    """1 if the first line of a CSV file is no line of numbers, else 0."""
    with path.open(encoding="utf-8-sig") as stream:
        first = stream.readline(100_000).split(",")[0].strip()
    try:
        float(first)
    except ValueError:
        return 0 if first.startswith("#") else 1
    return 0


def _of_rows(rows: FloatArray, path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coordinates (columns,), (rows,) and heights (rows, columns) from rows x, y, z."""
    if rows.shape[1] != 3:
        raise InputError(
            f"{path} has {rows.shape[1]} columns, not x, y, z; for a grid of heights give "
            "spacing: [dx, dy]"
        )
    (x, i), (y, j) = (_lines(rows[:, axis]) for axis in range(2))
    heights = np.full((len(y), len(x)), np.nan)
    heights[j, i] = rows[:, 2]
    if len(rows) != heights.size or np.isnan(heights).any():
        raise InputError(
            f"{path} has {len(rows)} rows, and {len(x)} different x times {len(y)} different y are "
            f"{heights.size}: the places do not fill a rectangular grid"
        )
    return x, y, heights


def _lines(values: FloatArray) -> tuple[FloatArray, IntArray]:
    """The different values, ascending, and for each value the number of its own."""
    order = np.argsort(values)
    ascending = values[order]
    steps = np.diff(ascending) > _SAME * (ascending[-1] - ascending[0])
    starts = np.append(0, np.flatnonzero(steps) + 1)
    number = np.empty(len(values), dtype=np.int64)
    number[order] = np.append(0, np.cumsum(steps))
    return ascending[starts], number


# A binary file has a head of 80 bytes and the number of triangles, and then 50 bytes for each:
# normal, three corners, and two bytes that nobody uses.
_HEAD, _RECORD = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])


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
        corners = _from_text(content, path)
    elif count >= 0 and b"\0" in content[:_HEAD]:
        raise InputError(
            f"{path} is cut off or no STL file: with {count} triangles a binary STL file has "
            f"{_HEAD + _RECORD.itemsize * count} bytes, and this file has {len(content)}"
        )
    else:
        raise InputError(
            f"{path} is neither an STL file, which begins with solid or is binary, nor a mesh of "
            "Gmsh, which begins with $MeshFormat"
        )
    if not len(corners):
        raise InputError(f"{path} holds no triangles")
    return corners


def _from_text(content: bytes, path: Path) -> FloatArray:
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
        return np.array(numbers, dtype=float).reshape(-1, 3, 3)
    except ValueError:
        raise InputError(
            f"{path} cannot be read as an STL file: a line with vertex has no three numbers"
        ) from None


# A triangle is degenerate if its height is below this share of its longest edge.
_FLAT = 1e-9
# Coordinates beyond are no lengths in any unit.
_LARGEST = 1e50
_GMSH = b"$MeshFormat"


@dataclass(frozen=True)
class ToolSurface:
    """Corners (m, 3), triangles (n, 3) as numbers of corners, and warnings.

    ``is_closed`` says that every edge belongs to two triangles.
    """

    points: FloatArray
    triangles: IntArray
    is_closed: bool
    warnings: tuple[str, ...]


def read_surface(
    path: Path,
    scale: float = 1.0,
    shift: Sequence[float] = (0.0, 0.0, 0.0),
    turned: bool = False,
    spacing: Sequence[float] | None = None,
) -> ToolSurface:
    """The triangles of a file, at ``scale`` times their coordinates plus ``shift``.

    The file is an STL file, a Gmsh file or a height map, whose ``spacing`` `read_heights` explains.
    With ``turned`` the other side is outside.  Raises InputError for a file that cannot be read,
    and for triangles that are not the surface of a foundation: at an edge of three triangles no
    side is outside.
    """
    require_size(path)
    if path.suffix.lower() in ENDINGS:
        points, triangles = read_heights(path, spacing)
        points = _placed(points, scale, shift, path)
        return ToolSurface(points, triangles[:, ::-1] if turned else triangles, False, ())
    if spacing is not None:
        raise InputError(f"{path} has triangles; spacing is for a height map, .csv or .npy")
    with path.open("rb") as stream:
        is_gmsh = stream.read(len(_GMSH)) == _GMSH
    corners = _placed(read_triangles(path) if is_gmsh else read_stl(path), scale, shift, path)
    return checked(corners[:, ::-1] if turned else corners, str(path))


def _placed(points: FloatArray, scale: float, shift: Sequence[float], path: Path) -> FloatArray:
    placed = scale * points + np.asarray(shift)
    if not np.isfinite(placed).all() or np.abs(placed).max() > _LARGEST:
        raise InputError(f"{path} has coordinates that are not finite, or too large")
    return np.asarray(placed)


def checked(corners: FloatArray, origin: str) -> ToolSurface:
    """The surface of triangles with the corners (n, 3, 3).

    Degenerate triangles and copies of triangles are left out.  Neighbours that look to different
    sides are turned where the surface is closed.  Raises InputError if nothing is left, for an edge
    of more than two triangles, and for an open surface whose triangles look to different sides.
    """
    warnings = []
    flat = _degenerate(corners)
    if flat.all():
        raise InputError(f"{origin} holds degenerate triangles only, which have no area")
    if flat.any():
        warnings.append(f"{origin}: {flat.sum()} degenerate triangles were left out")
    kept = corners[~flat]
    corner = kept.reshape(-1, 3)
    once, numbers = _distinct(corner)
    points: FloatArray = corner[once]
    triangles: IntArray = numbers.reshape(-1, 3)
    first, _ = _distinct(np.sort(triangles, axis=1))
    if len(first) < len(triangles):
        warnings.append(
            f"{origin}: {len(triangles) - len(first)} copies of triangles were left out"
        )
        triangles = triangles[np.sort(first)]
    edges = _Edges(triangles)
    if (edges.counts > 2).any():
        a, b = points[edges.ends[np.argmax(edges.counts)]]
        raise InputError(
            f"{origin}: {edges.counts.max()} triangles share the edge from {places.at(a)} to "
            f"{places.at(b)}, and a surface has two sides only where two do; leave out inner walls "
            "and doubled parts"
        )
    is_closed = bool((edges.counts == 2).all())
    turned = _to_turn(triangles, edges, origin)
    if turned.any():
        if not is_closed:
            raise InputError(
                f"{origin}: neighbouring triangles look to different sides, and an open surface "
                "does not tell which side is outside; let all triangles run counterclockwise seen "
                "from the body"
            )
        triangles[turned] = triangles[turned][:, ::-1]
        _let_look_outwards(points, triangles)
        warnings.append(f"{origin}: {turned.sum()} triangles looked inwards and were turned")
    if not is_closed:
        warnings.append(
            f"{origin}: the surface is open, {(edges.counts == 1).sum()} edges have one triangle "
            "only; the tool is behind the triangles, and the body must not reach around the rim"
        )
    return ToolSurface(points, triangles, is_closed, tuple(warnings))


def _degenerate(corners: FloatArray) -> BoolArray:
    """(n,) whether a triangle has no area, to rounding."""
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    return np.asarray(area <= _FLAT * longest**2)


def _distinct(rows: FloatArray | IntArray) -> tuple[IntArray, IntArray]:
    """The numbers of the first of equal rows (n, m), and for each row (n,) which of them it equals.

    Column after column gets numbers, as NumPy sorts whole rows ten times slower than numbers.
    """
    known = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:
        values, place = np.unique(column, return_inverse=True)
        known = np.unique(known * len(values) + place, return_inverse=True)[1]
    _, first, number = np.unique(known, return_index=True, return_inverse=True)
    return first.astype(np.int64), number.astype(np.int64)


class _Edges:
    """The edges of triangles (n, 3): their ``ends`` (e, 2) and in how many triangles they are.

    For each of the three sides of the triangles, side after side, ``of_side`` (3 n,) is the number
    of the edge and ``forward`` (3 n,) whether the side runs from its first end to its second.
    """

    def __init__(self, triangles: IntArray) -> None:
        sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        self.forward = sides[:, 0] < sides[:, 1]
        ends = np.sort(sides, axis=1)
        first, self.of_side = _distinct(ends)
        self.ends, self.counts = ends[first], np.bincount(self.of_side)


def _to_turn(triangles: IntArray, edges: _Edges, origin: str) -> BoolArray:
    """(n,) the triangles to turn so that neighbours look to the same side.

    Of each connected part the side that fewer triangles look to is turned.  Raises InputError if no
    choice is consistent, as on a Moebius strip.
    """
    count = len(triangles)
    order = np.argsort(edges.of_side, kind="stable")
    paired = edges.counts[edges.of_side[order]] == 2
    pairs = order[paired].reshape(-1, 2)
    one, other = pairs[:, 0] % count, pairs[:, 1] % count
    # Of two triangles that look to one side, one runs along the common edge and one against it.
    same = edges.forward[pairs[:, 0]] != edges.forward[pairs[:, 1]]
    if same.all():
        return np.zeros(count, dtype=bool)
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    # Two copies of each triangle, as it is and turned: a path joins those that look to one side.
    ends = np.where(same, other, other + count), np.where(same, other + count, other)
    rows, columns = np.concatenate([one, one + count]), np.concatenate(ends)
    graph = csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(2 * count, 2 * count))
    parts = connected_components(graph, directed=False)[1]
    if np.any(parts[:count] == parts[count:]):
        raise InputError(f"{origin} has no two sides, as a Moebius strip has none")
    lower = np.minimum(parts[:count], parts[count:])
    away = parts[:count] != lower
    few = 2 * np.bincount(lower, away) <= np.bincount(lower)
    return np.asarray(away == few[lower])


def _let_look_outwards(points: FloatArray, triangles: IntArray) -> None:
    """Turn a closed surface whose triangles look inwards, by the sign of its volume."""
    a, b, c = (points[triangles[:, i]] - points.mean(axis=0) for i in range(3))
    if np.sum(a * np.cross(b, c)) < 0.0:
        triangles[:] = triangles[:, ::-1]


def read_corners(path: Path, most: int) -> FloatArray:
    """The corners (m, 2), at most ``most``, in the first two columns; a heading is left out.

    Raises InputError for a line without two finite numbers.
    """
    found = []
    with rows_of(path, "contact") as rows:
        for number, row in enumerate(rows, start=1):
            if not row or row[0].lstrip().startswith("#"):
                continue
            corner = [number_at(place, row)[0] for place in (0, 1)]
            if np.isfinite(corner).all():
                found.append(corner)
            elif number > 1:
                raise InputError(f"{path}, line {number}: expected two numbers x, y")
            if len(found) > most:
                raise InputError(f"{path} has more than {most} corners")
    return np.array(found, dtype=float).reshape(-1, 2)
