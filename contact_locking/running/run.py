"""A run of a study file, from its parameters to the files of its results.

Each step of a process is saved when it is solved.  A run that was killed goes on from its last
complete step when it is started again with the same parameters.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from mpi4py import MPI

from contact_locking import study_file
from contact_locking.errors import ProcessEnded
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.process import solving
from contact_locking.process.checkpoint import saved_steps
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.results.output_folder import on_root_of
from contact_locking.results.solution import Solution, StudySolution
from contact_locking.running import writing
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.numerics import OutputParameters

S = TypeVar("S", bound=Solution)


def run(
    parameters: Parameters,
    directory: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
    save_state: bool = False,
) -> tuple[StudySolution, list[str]]:
    """The last solution, its results in ``directory``, and the warnings of writing; collective.

    Of a process fields.bp has every step with its time, and history.csv a row for each.
    ``restart`` is the folder of another run to go on from; without it a process goes on from what
    an earlier run with the same parameters has left in ``directory``.  ``save_state`` adds the
    checkpoint of the last solution.  Raises the errors of `solving.solve` and `writing.write`;
    where data cannot be used at a later time, the steps before are written first.
    """
    target, listener = Path(directory), monitor or Monitor()
    if parameters.steps is None:
        solution = solving.solve(parameters, comm, listener, petsc_options, restart)
        return solution, writing.write(solution, target, save_state)
    if checkpoint.unavailable() is None:
        name = on_root(comm, lambda: study_file.fingerprint(parameters))
        found = on_root_of(comm, target, lambda: saved_steps.unfinished(target, name))
        if found and restart is None:
            listener.message(f"going on from step {int(found[-1].name)} of an earlier run")
            restart = target
    solutions = solving.solve_steps(parameters, comm, listener, petsc_options, restart)
    return write_steps(solutions, target, comm, parameters.output, save_state)


def write_steps(
    solutions: Iterator[S],
    directory: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    output: OutputParameters | None = None,
    save_state: bool = False,
) -> tuple[S, list[str]]:
    """The last solution of a process, and the warnings of writing; collective.

    Each step is saved in ``directory``, for ``restart=directory``, until the process has reached
    its end; then :func:`write` writes, with all steps in fields.bp.
    """
    target, output = Path(directory), output or OutputParameters()
    last: S | None = None
    with contextlib.ExitStack() as stack:
        made = writing.FieldSeries(target, comm)
        series = stack.enter_context(made) if output.fields else None
        ended: ProcessEnded | None = None
        try:
            for solution in solutions:
                before, last = last, solution
                if before is not None and before.time == last.time:
                    continue
                if series is not None:
                    series.add(solution)
                is_new = solution.converged and solution.summary["restart"] is None
                if is_new and checkpoint.is_possible(solution.domain):
                    number = len(solution.history)
                    folder, name = target / saved_steps.FOLDER, saved_steps.name_of(number)
                    writing.save_as(solution, folder, name)
                    # Only fields and probes of all steps need the steps before.
                    first = 1 if output.fields or output.probes else number
                    on_root(comm, partial(saved_steps.keep, target, first, number))
        except ProcessEnded as error:
            # Data that cannot be used at a time do not take the steps before with them.
            ended = error
        assert last is not None
        last = last if ended is None else last.telling(**ended.entries)
        warnings = writing.write(last, target, save_state, series.finish() if series else None)
    if ended is not None:
        raise ended
    if last.converged:
        on_root(comm, lambda: saved_steps.remove(target))
    return last, warnings
