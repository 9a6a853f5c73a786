"""STL files, in text and in binary form, as arrays.

A file may come from anybody: its size is checked before its content is read, and the numbers of a
binary file are read as an array whose length the size of the file has confirmed.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.mesh_file.trusted import require_file

#: Larger files are not read: 250 MB hold 5 million triangles in binary form.
LARGEST_FILE = 250_000_000
# A binary file has a head of 80 bytes and the number of triangles, and then 50 bytes for each:
# normal, three corners, and two bytes that nobody uses.
_HEAD, _RECORD = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])


def check_size(path: Path, largest: int = LARGEST_FILE) -> None:
    """Raise InputError unless the path is a file of at least 1 and at most ``largest`` bytes."""
    require_file(path, "file", None)
    size = path.stat().st_size
    if size > largest:
        raise InputError(
            f"{path} has {size / 1e6:.0f} MB, and at most {largest / 1e6:.0f} MB are "
            "read; make the tool coarser, which need not be finer than the mesh of the body"
        )
    if size == 0:
        raise InputError(f"{path} is empty")


def read_stl(path: Path) -> FloatArray:
    """The corners (n, 3, 3) of the n triangles of an STL file, not checked yet.

    Raises InputError for a file that is no STL file, is cut off, or holds no triangles.
    """
    check_size(path)
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
