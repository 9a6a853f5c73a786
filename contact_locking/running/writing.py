"""The folder of a run: all files of a solution appear together, or none of them."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import shutil
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from mpi4py import MPI

from contact_locking import study_file, wings
from contact_locking.errors import MAKE_ROOM, ContactLockingError, NoRoom, require_kind
from contact_locking.files import atomic
from contact_locking.files.lock import make_folders
from contact_locking.process.checkpoint import stored as checkpoints
from contact_locking.results import fields, names, probe_table
from contact_locking.results.contact_points import facets_table
from contact_locking.results.output_folder import explained_in, on_root_of
from contact_locking.results.solution import Solution, StudySolution, summary_text
from contact_locking.results.table import Table
from contact_locking.study_file.parameters.numerics import OutputParameters


class FieldSeries(contextlib.AbstractContextManager["FieldSeries"]):
    """fields.bp of a process, which grows in a staging folder from step to step; collective."""

    def __init__(self, directory: Path, comm: MPI.Intracomm) -> None:
        self._target, self._comm = directory, comm
        self._stack = contextlib.ExitStack()
        self._series: fields.Series | None = None

    def __enter__(self) -> FieldSeries:
        self._path = self._stack.enter_context(_staging(self._comm, self._target)) / names.FIELDS
        return self

    def __exit__(self, *error: object) -> None:
        self._series = None
        self._stack.close()

    def add(self, solution: Solution) -> None:
        """Add the fields of a step with its time; collective."""
        comm, functions = self._comm, fields.discontinuous(solution)
        size = fields.size(functions, comm)
        on_root_of(comm, self._target, partial(atomic.require_room, self._path.parent, size))
        with _explained_alone(self._target, comm):
            if self._series is None:
                self._series = fields.Series(functions, self._path, comm)
            for own, new in zip(self._series.functions, functions, strict=True):
                own.x.array[:] = new.x.array
            self._series.add(solution.time)

    def finish(self) -> Path:
        """Complete the file, which :func:`write` moves to its place; collective."""
        if self._series is not None:
            with _explained_alone(self._target, self._comm):
                self._series.close()
        return self._path


def write(
    solution: Solution,
    directory: str | Path,
    checkpoint: bool = False,
    series: Path | None = None,
) -> list[str]:
    """Write all files of a solution and return the warnings, the same on all ranks; collective.

    The files are summary.json, contact.csv and contact_facets.csv, and parameters.yaml for a
    study.  The section ``output`` of a study, or its defaults, adds
    fields.bp or fields.xdmf, and picture.png; ``checkpoint`` adds the folder checkpoint.  A step of
    a process adds history.csv.  ``series``, the file of a `FieldSeries`, is fields.bp in place of
    the fields of this step.  The files are written into a staging folder and moved when all are
    complete.  They replace the results of an earlier run in the folder, also those that this one
    does not have; all other files stay.

    If the picture or the checkpoint cannot be made, a warning says so, also in summary.json.
    Raises InputError for a folder that cannot be written to or holds files of these names that no
    run has written, and ContactLockingError for a full disk; if only the picture or the checkpoint
    has no room, all other files are written first.
    """
    require_kind(solution, Solution, "a solution", "solution")
    comm, target = solution.domain.comm, Path(directory)
    wanted = OutputParameters()
    if isinstance(solution, StudySolution):
        wanted = solution.parameters.output
    warnings: list[str] = []
    refused: list[str] = []
    return_freed_memory()
    on_root_of(comm, target, partial(names.require_own, target))
    with _staging(comm, target) as staging:
        if series is not None:
            on_root_of(comm, target, partial(series.rename, staging / names.FIELDS))
        elif wanted.fields and "vtx" in wanted.formats:
            with FieldSeries(target, comm) as own:
                own.add(solution)
                made = own.finish()
                on_root_of(comm, target, partial(made.rename, staging / names.FIELDS))
        if wanted.fields and "xdmf" in wanted.formats:
            with _explained_alone(target, comm):
                fields.write_xdmf(solution, staging / names.XDMF, comm)
        for draw in wings.PICTURES if wanted.picture else ():
            try:
                warnings += draw(solution, staging)
            except NoRoom as error:
                refused.append(str(error))
        if checkpoint and (problem := _checkpoint(solution, target, staging)) is not None:
            is_possible = checkpoints.is_possible(solution.domain)
            (refused if is_possible else warnings).append(f"no checkpoint was saved: {problem}")
        told = [*solution.summary.get("warnings", []), *warnings, *refused]
        complete = solution.telling(warnings=told)

        def finish() -> None:
            _write_texts(complete, staging)
            for name in names.FILES_OF_RUN:
                atomic.put_in_place(staging / name, target / name)

        on_root_of(comm, target, finish)
    for number, other in enumerate(solution.others, start=2):
        warnings += write(other, target / names.folder_of(number), checkpoint)
    if refused:
        raise NoRoom(f"{'; '.join(refused)}; all other results are in {target}\n{MAKE_ROOM}")
    return warnings


def save(solution: Solution, directory: str | Path) -> None:
    """Save a checkpoint in ``directory``/checkpoint, for ``restart=directory``; collective.

    Any number of ranks can read the checkpoint on the same mesh.  Raises ContactLockingError if
    adios4dolfinx is missing, and InputError for a folder that cannot be written to or holds a
    checkpoint of others.
    """
    require_kind(solution, Solution, "a solution", "solution")
    comm, target = solution.domain.comm, Path(directory)
    on_root_of(comm, target, partial(names.require_own, target, [names.CHECKPOINT]))
    save_as(solution, target, names.CHECKPOINT)


def save_as(solution: Solution, directory: Path, name: str) -> None:
    """Save a checkpoint as ``directory``/``name``, whole or not at all, as :func:`save` does."""
    comm = solution.domain.comm
    with _staging(comm, directory) as staging:
        folder = staging / name
        _write_checkpoint(solution, directory, folder)
        on_root_of(comm, directory, lambda: atomic.put_in_place(folder, directory / name))


def _checkpoint(solution: Solution, target: Path, staging: Path) -> str | None:
    """Write a checkpoint and return None, or return why it failed; collective."""
    try:
        _write_checkpoint(solution, target, staging / names.CHECKPOINT)
        return None
    except ContactLockingError as error:
        reason = str(error).splitlines()[0]
    # ADIOS2 closes its files, and so frees the disk, when no reference to the error is left; the
    # frames of the error may refer to each other in a circle.
    gc.collect()
    comm = solution.domain.comm
    on_root_of(comm, target, lambda: shutil.rmtree(staging / names.CHECKPOINT, ignore_errors=True))
    return reason


def _write_checkpoint(solution: Solution, target: Path, folder: Path) -> None:
    comm = solution.domain.comm
    # The text files are written later and need room as well.
    size = checkpoints.size(solution) + names.TEXTS_BYTES

    def make_folder() -> None:
        atomic.require_room(folder.parent, size)
        folder.mkdir()

    on_root_of(comm, target, make_folder)
    checkpoints.write(solution, folder)


def _write_texts(solution: Solution, folder: Path) -> None:
    points, facets = solution.contact_points, solution.contact_facets
    assert points is not None and facets is not None
    texts = {
        names.SUMMARY: summary_text(solution.summary),
        names.CONTACT: points.table.text(),
        names.FACETS: facets_table(facets).text(),
    }
    if isinstance(solution, StudySolution):
        texts[names.PARAMETERS] = study_file.dump(solution.parameters)
    if len(solution.history):
        texts[names.HISTORY] = solution.history.text()
    if branches := solution.summary.get("branches"):
        # The points in the order of the branch.
        texts[names.BRANCHES] = Table(branches["points"]).text()
    if solution.probes:
        texts[names.PROBES] = probe_table.table(solution.probes).text()
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


def _explained_alone(
    directory: Path, comm: MPI.Intracomm
) -> contextlib.AbstractContextManager[None]:
    """`explained_in` on one rank.

    On several ranks the other ranks may wait inside ADIOS2, where no error reaches them: there the
    OSError of one rank has to end all ranks.
    """
    return explained_in(directory) if comm.size == 1 else contextlib.nullcontext()


@contextlib.contextmanager
def _staging(comm: MPI.Intracomm, directory: Path) -> Iterator[Path]:
    """A staging folder that rank 0 makes and all ranks use; collective."""
    with contextlib.ExitStack() as stack:

        def attempt() -> Path:
            make_folders(directory)
            return stack.enter_context(atomic.staging(directory))

        yield on_root_of(comm, directory, attempt)


def return_freed_memory() -> None:
    """Return the free memory of the C library to the system.

    The GNU C library keeps the memory of matrices and factors, in pieces that are too small for the
    arrays of the fields.  Other C libraries lack the function, and nothing happens.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
