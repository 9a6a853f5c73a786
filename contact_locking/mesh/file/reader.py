"""A mesh file as arrays, read by Gmsh in a process of its own.

A damaged file can crash Gmsh.  In this process the crash would end all ranks.  Gmsh runs a file
that is not a mesh as a Gmsh script, which can start programs.  For some endings of the name Gmsh
starts programs whatever the file holds, and it passes the names of compressed files to a shell.  A
file must therefore begin like a mesh, and Gmsh reads a copy with a fixed name in a folder of its
own.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from contact_locking.errors import InputError
from contact_locking.files.readable import require_file
from contact_locking.mesh.file.conversion import ENDINGS
from contact_locking.mesh.file.data import MeshData

# The first two lines of a mesh: "$MeshFormat", then version, 0 (text) or 1 (binary), and size.
_BEGIN = re.compile(rb"\$MeshFormat[ \t]*\r?\n[ \t]*(\d+(?:\.\d+)?)[ \t]+[01][ \t]+\d+[ \t]*\r?\n")
_BEGIN_LENGTH = 200
_VERSIONS = ("2", "2.1", "2.2", "4", "4.0", "4.1")


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
    if found is None and path.suffix.lower() in ENDINGS:
        made = path.with_suffix(".msh")
        raise InputError(
            f"{path} is a mesh of another program; this writes one that is read: "
            f"contact-locking mesh {path} -o {made}"
        )
    if found is None:
        raise InputError(
            f"{path} is not a mesh in Gmsh's format, which begins with the line $MeshFormat; "
            "in Gmsh, save the mesh as .msh (File > Export, or gmsh.write); a .geo script is not "
            "run here, as it can start programs"
        )
    version = found[1].decode()
    if version not in _VERSIONS:
        raise InputError(
            f"{path} is in version {version} of Gmsh's mesh format; 2.2, 4.0 and 4.1 can be read "
            "(Mesh.MshFileVersion in Gmsh)"
        )


_PROGRAM = "contact_locking.mesh.file.gmsh_model"
# With these environment variables of an MPI launcher the new process would count as a rank.
_LAUNCHERS = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_LOCAL", "HYDRA_")
_MESSAGE_TAIL = 300


def read(path: Path) -> MeshData:
    """The arrays of a mesh file, not checked yet; for one process.

    Raises InputError with the name of the file if it is not a mesh or cannot be read.
    """
    with trusted_copy(path) as copy:
        target = copy.with_name("arrays.npz")
        words = [sys.executable, "-P", "-m", _PROGRAM, str(copy), str(target), str(path)]
        done = subprocess.run(
            words,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            cwd=copy.parent,
            env=_environment(),
            check=False,
        )
        said = done.stdout.decode("utf-8", errors="replace").strip()
        if done.returncode == InputError.exit_code and said:
            raise InputError(said)
        if done.returncode != 0:
            last = done.stderr.decode("utf-8", errors="replace").strip()[-_MESSAGE_TAIL:]
            raise InputError(
                f"Gmsh cannot read {path}: it {_end(done.returncode)}"
                f"{' and said: ' if last else ''}{' '.join(last.split())}"
            )
        return MeshData.load(target)


def _environment() -> dict[str, str]:
    """The environment of this process without the MPI launcher, with this package in the path."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(_LAUNCHERS)}
    home = str(Path(__file__).resolve().parents[3])
    paths = [home, *map(os.path.abspath, kept.get("PYTHONPATH", home).split(os.pathsep))]
    return {**kept, "PYTHONPATH": os.pathsep.join(paths)}


def _end(code: int) -> str:
    if -code in list(signal.Signals):
        hint = ", perhaps for want of memory" if -code == signal.SIGKILL else ""
        return f"crashed ({signal.Signals(-code).name}{hint})"
    return f"ended with exit code {code}"
