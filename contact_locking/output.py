"""The results of a solve as files that appear complete or not at all."""

from __future__ import annotations

import contextlib
import ctypes
import errno
import gc
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from dolfinx import fem, io
from mpi4py import MPI

from contact_locking import checkpoint as checkpoints
from contact_locking import contact_table, plotting, report, study_file
from contact_locking.domain import on_root
from contact_locking.errors import MAKE_ROOM, ContactLockingError, NoRoom, not_written
from contact_locking.lock import (
    locked,
    make_folders,
    make_partial,
    new_folders,
    release,
    remove_abandoned,
)
from contact_locking.result_files import (
    CONTACT,
    FACETS,
    FIELDS,
    PARAMETERS,
    PICTURE,
    SNAPSHOT,
    SUMMARY,
    not_writable,
)
from contact_locking.solution import Solution

T = TypeVar("T")

KEY = "output.directory"
# The summary comes last: where it is, the rest is there too.
_ORDER = (PARAMETERS, CONTACT, FACETS, FIELDS, SNAPSHOT, PICTURE, checkpoints.NAME, SUMMARY)

# More than a summary, parameters and some hundred points of contact take.
_TEXTS_BYTES = 65_536
# Some file systems cannot reserve room.
_CANNOT_TELL = (errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS, errno.ENODEV)

FIELD_NAMES = (
    "displacement",
    "strain_norm",
    "locked",
    "elastic_stress",
    "locking_stress",
    "error_indicator",
    "contact_pressure",
    "tangential_traction",
    "smoothed_stress",
    "contact_state",
)


@contextlib.contextmanager
def reserved(directory: str | Path, comm: MPI.Intracomm) -> Iterator[None]:
    """Keep ``directory`` for the results of one run; collective.

    To be entered before the solve, which may take hours.  What a killed run has left there is
    removed; a folder that was not there goes again if nothing is written.  Raises what `prepare`
    raises, and InputError if another run or a study is writing there.
    """
    target = Path(directory)
    with contextlib.ExitStack() as stack:

        def attempt() -> None:
            stack.enter_context(new_folders(target))
            stack.enter_context(locked(target, "run"))
            remove_abandoned(target)
            _require_writable(target)

        _on_root(comm, target, attempt)
        yield


def prepare(directory: str | Path, comm: MPI.Intracomm) -> None:
    """Raise InputError if results cannot be written to ``directory``; leaves no trace; collective.

    Raises ContactLockingError where there is not even room for the texts.
    """
    target = Path(directory)

    def attempt() -> None:
        with new_folders(target):
            _require_writable(target)

    _on_root(comm, target, attempt)


def _require_writable(directory: Path) -> None:
    """Raise OSError if there is no room for a folder with the texts; leaves no trace."""
    folder, mark = make_partial(directory)
    try:
        _require_room(folder, _TEXTS_BYTES)
    finally:
        release(folder, mark)


def write(solution: Solution, directory: str | Path, checkpoint: bool = False) -> list[str]:
    """Write all files of a solution and return warnings, the same on all ranks; collective.

    summary.json, parameters.yaml, contact.csv and contact_facets.csv, as ``output`` asks for them
    fields.bp, and picture.png with snapshot.npz, and with ``checkpoint`` the state to restart from;
    of an earlier run in the folder nothing stays.  Each file is made in a folder beside its place
    and moved there when all are complete.  A picture or a checkpoint that cannot be made is a
    warning, in the summary too.  A folder that cannot be written to raises InputError, a full disk
    ContactLockingError: where only picture or checkpoint have no room, after all else is written.
    """
    comm, target = solution.domain.comm, Path(directory)
    wanted = solution.parameters.output
    warnings: list[str] = []
    refused: list[str] = []
    with _staging(comm, target) as staging:
        if wanted.fields:
            _write_fields(solution, target, staging / FIELDS)
        if wanted.picture:
            try:
                problem = plotting.picture(solution, staging)
            except NoRoom as error:
                refused.append(f"no picture was drawn: {error}")
            else:
                warnings += [problem] if problem else []
        if checkpoint and (problem := _checkpoint(solution, target, staging)) is not None:
            missing = checkpoints.unavailable() is not None
            (warnings if missing else refused).append(f"no checkpoint was saved: {problem}")
        told = [*solution.summary.get("warnings", []), *warnings, *refused]
        solution.summary["warnings"] = told

        def finish() -> None:
            _write_texts(solution, staging)
            report.discard(target)
            for name in _ORDER:
                _put_in_place(staging, target, name)

        _on_root(comm, target, finish)
    if refused:
        raise NoRoom(f"{'; '.join(refused)}; all other results are in {target}\n{MAKE_ROOM}")
    return warnings


def save(solution: Solution, directory: str | Path) -> None:
    """Write the checkpoint alone, in place of an earlier one; see :meth:`Solution.save`."""
    comm, target = solution.domain.comm, Path(directory)
    with _staging(comm, target) as staging:
        _write_checkpoint(solution, target, staging)
        _on_root(comm, target, lambda: _put_in_place(staging, target, checkpoints.NAME))


def summary_text(summary: dict[str, Any]) -> str:
    """The summary as JSON.

    JSON has no infinity and no NaN: such a number becomes null, and ``not_finite`` says for its
    dotted key which it was.
    """
    not_finite: dict[str, str] = {}
    plain = _jsonable(summary, "", not_finite)
    if not_finite:
        plain["not_finite"] = not_finite
    return json.dumps(plain, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def fields(solution: Solution) -> list[fem.Function]:
    """All fields as discontinuous P1 functions.

    P1 and P0 are both contained in discontinuous P1, and a VTX file holds functions of one
    element only.  Values are copied corner by corner, so that 0 and 1 stay 0 and 1.
    """
    corners: dict[tuple[int, ...], fem.FunctionSpace] = {}
    copies = []
    for name in FIELD_NAMES:
        function = getattr(solution, name)
        shape = function.ufl_shape
        if shape not in corners:
            element = ("DG", 1, shape) if shape else ("DG", 1)
            corners[shape] = fem.functionspace(solution.domain.mesh, element)
        copy = fem.Function(corners[shape], name=name)
        given, wanted = function.function_space.dofmap, copy.function_space.dofmap
        # A P0 function has one node in a cell, whose value goes to every corner.
        values = function.x.array.reshape(-1, given.bs)[given.list]
        copy.x.array.reshape(-1, wanted.bs)[wanted.list] = values
        copies.append(copy)
    return copies


def _write_fields(solution: Solution, target: Path, path: Path) -> None:
    comm, functions = solution.domain.comm, fields(solution)
    _on_root(comm, target, partial(_require_room, path.parent, _vtx_bytes(functions, comm)))
    file = io.VTXWriter(comm, path, functions, engine="BP4")
    try:
        file.write(0.0)
        file.close()
    except RuntimeError as error:
        # The room was taken meanwhile.  ADIOS2's destructor would try again, and an exception that
        # leaves a destructor ends the process: nobody may call it.
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(file))
        told = re.search(r"errno = (\d+)", str(error))
        # Not all of its errors hold a number.
        filled = shutil.disk_usage(path.parent).free < _TEXTS_BYTES
        number = int(told[1]) if told else errno.ENOSPC if filled else errno.EIO
        refusal = OSError(number, os.strerror(number), str(path))
        if comm.size > 1:
            # The other ranks may be waiting inside ADIOS2, and cannot be told.
            raise refusal from error
        raise not_written(not_writable(target), refusal, target, KEY) from error


def _vtx_bytes(functions: list[fem.Function], comm: MPI.Intracomm) -> int:
    """What `_write_fields` takes at most: values, mesh, and ADIOS2's notes of each rank."""
    mesh = functions[0].function_space.mesh
    cells = mesh.topology.index_map(mesh.topology.dim).size_global
    corners = cells * (mesh.topology.dim + 1)
    # ParaView takes vectors of 3 and tensors of 9 components; a point has 3, a number and a mark.
    components = sum({0: 1, 1: 3, 2: 9}[len(f.ufl_shape)] for f in functions) + 3 + 2
    return int(8 * (components * corners + corners + cells) + 32_768 * (1 + comm.size))


def _require_room(folder: Path, size: int) -> None:
    """Raise OSError if a file of so many bytes has no room; leaves no trace."""
    allocate = getattr(os, "posix_fallocate", None)
    if allocate is None:
        return
    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            allocate(file.fileno(), 0, size)
        except OSError as error:
            if error.errno not in _CANNOT_TELL:
                raise OSError(error.errno, error.strerror, str(folder)) from error


def _checkpoint(solution: Solution, target: Path, staging: Path) -> str | None:
    """Write a checkpoint and return None, or why there is none; collective."""
    try:
        _write_checkpoint(solution, target, staging)
        return None
    except ContactLockingError as error:
        reason = str(error).splitlines()[0]
    # ADIOS2 closes its files, and the room gets free, when nothing of the error is left; frames may
    # hold each other.
    gc.collect()
    comm = solution.domain.comm
    _on_root(comm, target, lambda: shutil.rmtree(staging / checkpoints.NAME, ignore_errors=True))
    return reason


def _write_checkpoint(solution: Solution, target: Path, staging: Path) -> None:
    folder, comm = staging / checkpoints.NAME, solution.domain.comm
    # The texts, which come later, are not to miss the room.
    size = checkpoints.size(solution) + _TEXTS_BYTES

    def make_folder() -> None:
        _require_room(staging, size)
        folder.mkdir()

    _on_root(comm, target, make_folder)
    checkpoints.write(solution, folder)


def _write_texts(solution: Solution, folder: Path) -> None:
    """Everything that rank 0 writes alone."""
    (folder / PARAMETERS).write_text(study_file.dump(solution.parameters), encoding="utf-8")
    (folder / SUMMARY).write_text(summary_text(solution.summary), encoding="utf-8")
    points, facets = solution.contact_points, solution.contact_facets
    assert points is not None and facets is not None
    with (folder / CONTACT).open("w", encoding="utf-8", newline="") as stream:
        contact_table.write_points(points, stream)
    with (folder / FACETS).open("w", encoding="utf-8", newline="") as stream:
        contact_table.write_facets(facets, stream)


def _jsonable(value: Any, key: str, not_finite: dict[str, str]) -> Any:
    match value:
        case dict():
            return {
                str(name): _jsonable(item, f"{key}.{name}" if key else str(name), not_finite)
                for name, item in value.items()
            }
        case list() | tuple() | np.ndarray():
            return [_jsonable(item, f"{key}.{i}", not_finite) for i, item in enumerate(value)]
        case np.generic():
            return _jsonable(value.item(), key, not_finite)
        case float() if not math.isfinite(value):
            not_finite[key] = str(value)
            return None
    return value


def _on_root(comm: MPI.Intracomm, directory: Path, work: Callable[[], T]) -> T:
    """``on_root``, where what the system refuses becomes an error about the folder."""

    def attempt() -> T:
        try:
            return work()
        except OSError as error:
            raise not_written(not_writable(directory), error, directory, KEY) from error

    return on_root(comm, attempt)


@contextlib.contextmanager
def _staging(comm: MPI.Intracomm, directory: Path) -> Iterator[Path]:
    """A folder beside the results for what is not complete yet; collective."""
    with contextlib.ExitStack() as stack:

        def attempt() -> Path:
            make_folders(directory)
            folder, mark = make_partial(directory)
            stack.callback(release, folder, mark)
            return folder

        yield _on_root(comm, directory, attempt)


def _put_in_place(staging: Path, target: Path, name: str) -> None:
    """Swap a finished file or folder for the old one, which goes with the staging folder."""
    new, place = staging / name, target / name
    # A file is replaced in one step; a folder, or what this run does not have, moves away first.
    if place.is_dir() or not new.exists():
        with contextlib.suppress(FileNotFoundError):
            place.rename(staging / f"old-{name}")
    if new.exists():
        os.replace(new, place)
