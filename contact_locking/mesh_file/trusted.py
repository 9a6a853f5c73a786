"""What may reach Gmsh of a mesh file that comes from anybody.

Gmsh runs whatever is no mesh as a script of its own, which can start programs; for some endings of
a name it starts programs too, whatever the file holds; and it hands the names of compressed files
to a shell.  So a file has to begin as Gmsh's mesh format does, and Gmsh sees a copy of it, by a
name of ours in a folder that holds nothing else.
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
# The first two lines of the format: "$MeshFormat", then version, 0 (text) or 1 (binary), size.
_BEGIN = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(\d+(?:\.\d+)?)[ \t]+[01][ \t]+\d+[ \t]*\r?\n")
_BEGIN_LENGTH = 200
_VERSIONS = ("2", "2.1", "2.2", "4", "4.0", "4.1")


@contextmanager
def trusted_copy(path: Path) -> Iterator[Path]:
    """A copy of the mesh file that Gmsh can only read as a mesh, until the end of the block.

    Raises InputError for what is no file, or is not in Gmsh's mesh format (MSH 2 or 4).
    """
    if not path.exists():
        raise InputError(f"there is no mesh file {path}", _KEY)
    # Before it is opened: a pipe would wait for someone to write.
    if not stat.S_ISREG(path.stat().st_mode):
        raise InputError(f"{path} is no file", _KEY)
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
