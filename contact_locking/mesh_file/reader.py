"""A mesh file as arrays, read by Gmsh in a process of its own.

A damaged file can crash Gmsh.  In this process the crash would end all ranks.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError
from contact_locking.mesh_file.data import MeshData
from contact_locking.mesh_file.trusted import trusted_copy

_KEY = "mesh.file"
_PROGRAM = "contact_locking.mesh_file.gmsh_process"
# With these environment variables of an MPI launcher the new process would count as a rank.
_LAUNCHERS = ("OMPI_", "PMIX_", "PMI_", "PRTE_", "MPI_LOCAL", "HYDRA_")
_MESSAGE_TAIL = 300


def read(path: Path) -> MeshData:
    """The arrays of a mesh file, not checked yet; for one process.

    Raises InputError with the name of the file if it is not a mesh or cannot be read.
    """
    with _read(path, "body") as arrays:
        return MeshData.load(arrays)


def read_triangles(path: Path) -> FloatArray:
    """The corners (n, 3, 3) of the triangles in a mesh file, not checked yet; for one process.

    Raises InputError with the name of the file if it has no triangles or cannot be read.
    """
    with _read(path, "triangles") as arrays, np.load(arrays, allow_pickle=False) as file:
        return np.asarray(file["corners"])


@contextmanager
def _read(path: Path, what: str) -> Iterator[Path]:
    """The file of arrays that the process has written; it lasts until the block ends."""
    with trusted_copy(path) as copy:
        target = copy.with_name("arrays.npz")
        words = [sys.executable, "-P", "-m", _PROGRAM, str(copy), str(target), str(path), what]
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
            raise InputError(said, _KEY)
        if done.returncode != 0:
            last = done.stderr.decode("utf-8", errors="replace").strip()[-_MESSAGE_TAIL:]
            raise InputError(
                f"Gmsh cannot read {path}: it {_end(done.returncode)}"
                f"{' and said: ' if last else ''}{' '.join(last.split())}",
                _KEY,
            )
        yield target


def _environment() -> dict[str, str]:
    """The environment of this process without the MPI launcher, with this package in the path."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(_LAUNCHERS)}
    home = str(Path(__file__).resolve().parents[2])
    paths = [home, *map(os.path.abspath, kept.get("PYTHONPATH", home).split(os.pathsep))]
    return {**kept, "PYTHONPATH": os.pathsep.join(paths)}


def _end(code: int) -> str:
    if -code in list(signal.Signals):
        hint = ", perhaps for want of memory" if -code == signal.SIGKILL else ""
        return f"crashed ({signal.Signals(-code).name}{hint})"
    return f"ended with exit code {code}"
