"""The protection from mesh files that start programs.

Gmsh runs a file that is not a mesh as a Gmsh script, which can start programs.  For some endings of
the name Gmsh starts programs whatever the file holds, and it passes the names of compressed files
to a shell.  A file must therefore begin like a mesh, and Gmsh reads a copy with a fixed name in a
folder of its own.
"""

from __future__ import annotations

import re
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from contact_locking.errors import InputError

_KEY = "mesh.file"
# The first two lines of a mesh: "$MeshFormat", then version, 0 (text) or 1 (binary), and size.
_BEGIN = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(\d+(?:\.\d+)?)[ \t]+[01][ \t]+\d+[ \t]*\r?\n")
_BEGIN_LENGTH = 200
_VERSIONS = ("2", "2.1", "2.2", "4", "4.0", "4.1")


def require_file(path: Path, kind: str = "mesh file", key: str | None = _KEY) -> None:
    """Raise InputError, with the key, unless the path is a regular file.

    This comes before a file is opened: to open a pipe would wait for a writer.
    """
    if not path.exists():
        raise InputError(f"there is no {kind} {path}", key)
    if not stat.S_ISREG(path.stat().st_mode):
        raise InputError(f"{path} is no file", key)


@contextmanager
def trusted_copy(path: Path) -> Iterator[Path]:
    """A copy of the mesh file that Gmsh can read as a mesh only; it lasts until the block ends.

    Raises InputError unless the path is a file in Gmsh's mesh format (MSH 2 or 4).
    """
    require_file(path)
    with tempfile.TemporaryDirectory(prefix="contact-locking-") as folder:
        copy = Path(folder, "mesh.msh")
        with path.open("rb") as source, copy.open("wb") as target:
            _check_begin(source, path)
            shutil.copyfileobj(source, target, 1 << 20)
        yield copy


def _check_begin(stream: BinaryIO, path: Path) -> None:
    begin = stream.read(_BEGIN_LENGTH)
    stream.seek(0)
    found = _BEGIN.match(begin)
    if found is None and path.suffix == ".geo":
        script = (
            "import gmsh; gmsh.initialize(); gmsh.open({source!r}); {mesh}; gmsh.write({made!r})"
        )
        mesh = "gmsh.model.mesh.generate(gmsh.model.getDimension())"
        words = script.format(source=str(path), mesh=mesh, made=str(path.with_suffix(".msh")))
        raise InputError(
            f"{path} is a script of Gmsh, which can start programs and is not run here; if you "
            f'trust it, this makes the mesh: python3 -c "{words}"',
            _KEY,
        )
    if found is None:
        raise InputError(
            f"{path} is not a mesh in Gmsh's format, which begins with the line $MeshFormat; "
            "in Gmsh, save the mesh as .msh (File > Export, or gmsh.write)",
            _KEY,
        )
    version = found[1].decode()
    if version not in _VERSIONS:
        raise InputError(
            f"{path} is in version {version} of Gmsh's mesh format; 2.2, 4.0 and 4.1 can be read "
            "(Mesh.MshFileVersion in Gmsh)",
            _KEY,
        )
