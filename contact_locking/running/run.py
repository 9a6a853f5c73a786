"""A run: from the parameters of a study file to its folder, whose files appear together or not.

Each step of a process is saved when it is solved.  A run that was killed goes on from its last
complete step when it is started again with the same parameters.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

from contact_locking import files, study_file, wings
from contact_locking.arrays import IntArray
from contact_locking.errors import (
    MAKE_ROOM,
    ContactLockingError,
    InputError,
    NoRoom,
    ProcessEnded,
    require_kind,
)
from contact_locking.files import make_folders
from contact_locking.findings import Finding
from contact_locking.parallel import agree, on_root
from contact_locking.process import checkpoint as checkpoints
from contact_locking.process.loop import Process
from contact_locking.results import fields
from contact_locking.results import output as names
from contact_locking.results.output import Output, explained_in, on_root_of
from contact_locking.results.probes import in_step, locate, sample
from contact_locking.results.solution import Solution, summary_text
from contact_locking.results.table import Table
from contact_locking.running import solving
from contact_locking.running.cases import Outcome, State, case_folder, row_of, write_rows
from contact_locking.solver.monitor import Monitor
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.study import StudyParameters

S = TypeVar("S", bound=Solution)


def run(
    parameters: Parameters,
    directory: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
    save_state: bool = False,
) -> tuple[Solution, list[Finding]]:
    """The last solution, its results in ``directory``, and the warnings of writing; collective.

    Of a process fields.vtkhdf has every step with its time, and history.csv a row for each.
    ``restart`` is the folder of another run to go on from; without it a process goes on from what
    an earlier run with the same parameters has left in ``directory``.  ``save_state`` adds the
    checkpoint of the last solution.  Raises the errors of `solving.solve` and `write`;
    where data cannot be used at a later time, the steps before are written first.
    """
    target, listener = Path(directory), monitor or Monitor()
    start = None if restart is None or save_state else checkpoints.locate(restart).resolve()
    if start == checkpoints.locate(target).resolve():
        raise InputError(
            f"the results would replace the checkpoint in {target} that the run starts from: add "
            "--checkpoint to save the new state there, or give another folder by --output"
        )
    if parameters.steps is None:
        solution = solving.solve(parameters, comm, listener, petsc_options, restart)
        return solution, write(solution, target, parameters.output, save_state)
    name = on_root(comm, lambda: study_file.fingerprint(parameters))
    last = on_root_of(comm, target, lambda: checkpoints.SavedSteps(target).prepare(name))
    if last > 0 and restart is None:
        listener.message(f"going on from step {last} of an earlier run")
        restart = target
    solutions = solving.solve_steps(parameters, comm, listener, petsc_options, restart)
    return write_steps(solutions, target, parameters.output, save_state, comm)


def write_steps(
    solutions: Iterator[S],
    directory: str | Path,
    output: Output | None = None,
    save_state: bool = False,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> tuple[S, list[Finding]]:
    """The last solution of a process, and the warnings of writing; collective.

    Each step is saved in ``directory``, for ``restart=directory``, until the process has reached
    its end; then :func:`write` writes, with all steps in fields.vtkhdf.
    """
    target, output = Path(directory), output or Output()
    saved = checkpoints.SavedSteps(target)
    last: S | None = None
    probes: Table | None = None
    with contextlib.ExitStack() as stack:
        series = None
        if output.fields:
            series = stack.enter_context(FieldSeries(target, comm))
        ended: ProcessEnded | None = None
        try:
            for solution in solutions:
                before, last = last, completed(solution, output)
                if before is not None and before.time == last.time:
                    continue
                # A study samples its probes itself, and has those of all steps.
                if solution.probes is None and last.probes is not None:
                    last = replace(last, probes=last.probes.after(probes or Table()))
                probes = last.probes
                if series is not None:
                    series.add(last)
                if last.converged and last.facts["restart"] is None:
                    number = len(last.history)
                    save_as(last, saved.folder, saved.name_of(number))
                    # Only fields and probes of all steps need the steps before.
                    first = 1 if output.fields or output.probes else number
                    on_root(comm, partial(saved.keep, first, number))
        except ProcessEnded as error:
            # Data that cannot be used at a time do not take the steps before with them.
            ended = error
        assert last is not None
        last = last if ended is None else last.with_entries(**ended.entries)
        last = replace(last, probes=probes)
        warnings = write(last, target, output, save_state, series.path if series else None)
    if ended is not None:
        raise ended
    if last.converged:
        on_root(comm, saved.remove)
    return last, warnings


class FieldSeries(contextlib.ExitStack):
    """fields.vtkhdf, which grows in a staging folder from step to step; collective."""

    def __init__(self, directory: Path, comm: MPI.Intracomm) -> None:
        super().__init__()
        self._target, self._comm, self._new = directory, comm, True
        self.path: Path = self.enter_context(_staging(comm, directory)) / names.FIELDS

    def add(self, solution: Solution) -> None:
        """Add the fields of a step with its time, one rank after the other; collective."""
        comm, functions = self._comm, fields.discontinuous(solution)
        size = comm.allreduce(fields.size(functions))
        on_root_of(comm, self._target, partial(files.require_room, self.path.parent, size))

        def append() -> None:
            with explained_in(self._target):
                fields.append(functions, self.path, solution.time, self._new)

        for rank in range(comm.size):
            agree(comm, append if rank == comm.rank else lambda: None)
        self._new = False


def completed(solution: S, output: Output) -> S:
    """A solution with the probes and the labels of units of ``output``; collective."""
    domain = solution.domain
    if output.probes and solution.probes is None:
        sampled = sample(locate(domain, output.probes), solution)
        sampled = in_step(sampled, len(solution.history), solution.time)
        solution = replace(solution, probes=sampled)
    labels = output.labels(domain.dim, domain.axisymmetric)
    return solution.with_entries(units=labels) if labels else solution


def write(
    solution: Solution,
    directory: str | Path,
    output: Output | None = None,
    checkpoint: bool = False,
    series: Path | None = None,
) -> list[Finding]:
    """Write all files of a solution and return the warnings, the same on all ranks; collective.

    The files are summary.json, contact.csv and contact_facets.csv, and parameters.yaml for a
    study.  ``output``, by default the section of a study, adds fields.vtkhdf, picture.png and
    probes.csv; ``checkpoint`` adds the folder checkpoint.  A step of a process adds history.csv.
    ``series``, the file of a `FieldSeries`, is fields.vtkhdf in place of the fields of this step.
    The files are written into a staging folder and moved when all are complete.  They replace the
    results of an earlier run in the folder, also those that this one does not have; all other
    files stay.

    If the picture cannot be made, a warning says so, also in summary.json.
    Raises InputError for a folder that cannot be written to or holds files of these names that no
    run has written, and ContactLockingError for a full disk; if only the picture or the checkpoint
    has no room, all other files are written first.
    """
    require_kind(solution, Solution, "a solution", "solution")
    comm, target = solution.domain.comm, Path(directory)
    if output is None:
        output = Output() if solution.parameters is None else solution.parameters.output
    solution = completed(solution, output)
    warnings: list[Finding] = []
    refused: list[str] = []
    return_freed_memory()
    on_root_of(comm, target, partial(names.require_own, target))
    with _staging(comm, target) as staging:
        if series is not None:
            on_root_of(comm, target, partial(series.rename, staging / names.FIELDS))
        elif output.fields:
            with FieldSeries(target, comm) as alone:
                alone.add(solution)
                on_root_of(comm, target, partial(alone.path.rename, staging / names.FIELDS))
        for draw in wings.PICTURES if output.picture else ():
            try:
                warnings += draw(solution, staging)
            except NoRoom as error:
                refused.append(str(error))
        if checkpoint:
            folder, write_folder = staging / names.CHECKPOINT, checkpoints.gathered(solution)
            try:
                on_root_of(comm, target, lambda: write_folder(folder))
            except ContactLockingError as error:
                refused.append(f"no checkpoint was saved: {str(error).splitlines()[0]}")
                on_root_of(comm, target, lambda: shutil.rmtree(folder, ignore_errors=True))
        left_out = [Finding("output.left_out", reason=reason) for reason in refused]
        complete = solution.with_warnings(*warnings, *left_out)

        def finish() -> None:
            _write_texts(complete, staging)
            for name in names.FILES_OF_RUN:
                files.replace_file(staging / name, target / name)

        on_root_of(comm, target, finish)
    for number, other in enumerate(solution.others, start=2):
        warnings += write(other, target / names.folder_of(number), output, checkpoint)
    if refused:
        raise NoRoom(f"{'; '.join(refused)}; all other results are in {target}\n{MAKE_ROOM}")
    return warnings


def save(solution: Solution, directory: str | Path) -> None:
    """Save a checkpoint in ``directory``/checkpoint, for ``restart=directory``; collective.

    Any number of ranks can read the checkpoint on the same mesh.  Raises InputError for a folder
    that cannot be written to or holds a checkpoint of others, and ContactLockingError for a full
    disk.
    """
    require_kind(solution, Solution, "a solution", "solution")
    comm, target = solution.domain.comm, Path(directory)
    on_root_of(comm, target, partial(names.require_own, target, [names.CHECKPOINT]))
    save_as(solution, target, names.CHECKPOINT)


def save_as(solution: Solution, directory: Path, name: str) -> None:
    """Save a checkpoint as ``directory``/``name``, whole or not at all, as :func:`save` does."""
    comm = solution.domain.comm
    with _staging(comm, directory) as staging:
        folder, write_folder = staging / name, checkpoints.gathered(solution)
        on_root_of(comm, directory, lambda: write_folder(folder))
        on_root_of(comm, directory, lambda: files.replace_file(folder, directory / name))


def facets_table(facets: IntArray) -> Table:
    """The columns of contact_facets.csv: the corners of facets (m, d) as point numbers from 0."""
    return Table({f"point_{corner}": column for corner, column in enumerate(facets.T)})


def _write_texts(solution: Solution, folder: Path) -> None:
    points, facets = solution.contact_points, solution.contact_facets
    assert points is not None and facets is not None
    texts = {
        names.SUMMARY: summary_text(solution.summary),
        names.CONTACT: points.table.text(),
        names.FACETS: facets_table(facets).text(),
    }
    if solution.parameters is not None:
        texts[names.PARAMETERS] = study_file.dump(solution.parameters)
    if len(solution.history):
        texts[names.HISTORY] = solution.history.text()
    if branches := solution.facts.get("branches"):
        # The points in the order of the branch.
        texts[names.BRANCHES] = Table(branches["points"]).text()
    if solution.probes is not None:
        texts[names.PROBES] = solution.probes.text()
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


@contextlib.contextmanager
def _staging(comm: MPI.Intracomm, directory: Path) -> Iterator[Path]:
    """A staging folder that rank 0 makes and all ranks use; collective."""
    with contextlib.ExitStack() as stack:

        def attempt() -> Path:
            make_folders(directory)
            return stack.enter_context(files.staging(directory))

        yield on_root_of(comm, directory, attempt)


def return_freed_memory() -> None:
    """Return the free memory of the C library to the system.

    The GNU C library keeps the memory of matrices and factors, in pieces that are too small for the
    arrays of the fields.  Other C libraries lack the function, and nothing happens.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def solve_cases(
    make_problem: Callable[..., Any],
    cases: Mapping[str, Any] | Sequence[Mapping[str, Any]],
    directory: str | Path | None = None,
    output: Output | None = None,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> list[dict[str, Any]]:
    """A row for each case: its values, its state, and the numbers of its solution; collective.

    The rows are those of table.csv of a study file, with the names of summary.json as dotted keys.
    The cases are solved one after the other, by all ranks together.  A case that cannot be solved
    has the state ``failed`` with the reason, and the others go on.  Raises InputError for cases
    that cannot be used, and the errors of writing.

    Parameters
    ----------
    make_problem
        ``make_problem(**values)`` returns the ContactProblem of a case, a :class:`Process`, or an
        iterator over solutions, as :func:`adapt` does, of which the last counts
    cases
        values by name, as ``{"mu": [0.1, 0.3], "n": {"geometric": [1e2, 1e6, 5]}}``: every
        combination of them; or a list of mappings, one for each case
    directory
        the folder of table.csv and table.jsonl, with the results of each case below ``cases``;
        without one there are no files
    output
        which files each case has
    """
    if isinstance(cases, Mapping):
        cases = StudyParameters(vary=dict(cases)).cases()
    rows = []
    for number, values in enumerate(cases, start=1):
        name = f"{number:04d}"
        place = None if directory is None else case_folder(Path(directory), name)
        try:
            outcome = _outcome(make_problem(**values), place, output, comm)
        except ContactLockingError as error:
            if isinstance(error, NoRoom):
                raise
            about = f"{error.key}: " if isinstance(error, InputError) and error.key else ""
            outcome = Outcome("failed", f"{about}{error}")
        rows.append(row_of(values, name, outcome))
        if directory is not None:
            on_root_of(comm, Path(directory), lambda: write_rows(Path(directory), rows))
    return rows


def _outcome(made: Any, place: Path | None, output: Output | None, comm: MPI.Intracomm) -> Outcome:
    """The outcome of a problem, or of what iterates over solutions, with its files in a folder."""
    with contextlib.ExitStack() as stack:
        owner = made.problem if isinstance(made, Process) else made
        if hasattr(owner, "close"):
            stack.callback(owner.close)
        if not hasattr(made, "solve") and place is not None:
            solution, _ = write_steps(made, place, output, comm=comm)
        else:
            solution = made.solve() if hasattr(made, "solve") else deque(made, maxlen=1)[0]
            if place is not None:
                write(solution, place, output)
        summary = json.loads(summary_text(solution.summary))
    state: State = "converged" if solution.converged else "not converged"
    return Outcome(state, solution.reason, summary)
