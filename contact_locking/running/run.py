"""A run of a study file, from its parameters to the files of its results.

Each step of a process is saved when it is solved.  A run that was killed goes on from its last
complete step when it is started again with the same parameters.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking import study_file
from contact_locking.errors import InputError, ProcessEnded
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.process.checkpoint import saved_steps
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.process.checkpoint.record import locate
from contact_locking.results.output import Output
from contact_locking.results.output_folder import on_root_of
from contact_locking.results.probe_points import ProbeSample
from contact_locking.running import solving, writing
from contact_locking.running.writing import S
from contact_locking.study.solution import StudySolution
from contact_locking.study_file.parameters import Parameters


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
    if save_state and (missing := checkpoint.unavailable()) is not None:
        listener.message(f"warning: no checkpoint will be saved: {missing}")
    given = None if restart is None or save_state else locate(restart).resolve()
    if given == locate(target).resolve():
        raise InputError(
            f"the results would replace the checkpoint in {target} that the run starts from: add "
            "--checkpoint to save the new state there, or give another folder by --output"
        )
    if parameters.steps is None:
        solution = solving.solve(parameters, comm, listener, petsc_options, restart)
        return solution, writing.write(solution, target, parameters.output, save_state)
    if checkpoint.unavailable() is None:
        name = on_root(comm, lambda: study_file.fingerprint(parameters))
        found = on_root_of(comm, target, lambda: saved_steps.unfinished(target, name))
        if found and restart is None:
            listener.message(f"going on from step {int(found[-1].name)} of an earlier run")
            restart = target
    solutions = solving.solve_steps(parameters, comm, listener, petsc_options, restart)
    return write_steps(solutions, target, parameters.output, save_state, comm)


def write_steps(
    solutions: Iterator[S],
    directory: str | Path,
    output: Output | None = None,
    save_state: bool = False,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
) -> tuple[S, list[str]]:
    """The last solution of a process, and the warnings of writing; collective.

    Each step is saved in ``directory``, for ``restart=directory``, until the process has reached
    its end; then :func:`write` writes, with all steps in fields.bp.
    """
    target, output = Path(directory), output or Output()
    last: S | None = None
    taken: dict[int, ProbeSample] = {}
    with contextlib.ExitStack() as stack:
        series = None
        if output.fields:
            series = stack.enter_context(writing.FieldSeries(target, comm))
        ended: ProcessEnded | None = None
        try:
            for solution in solutions:
                before, last = last, writing.completed(solution, output)
                if before is not None and before.time == last.time:
                    continue
                taken |= {sample.step: sample for sample in last.probes}
                if series is not None:
                    series.add(last)
                is_new = last.converged and last.summary["restart"] is None
                if is_new and checkpoint.is_possible(last.domain):
                    number = len(last.history)
                    folder, name = target / saved_steps.FOLDER, saved_steps.name_of(number)
                    writing.save_as(last, folder, name)
                    # Only fields and probes of all steps need the steps before.
                    first = 1 if output.fields or output.probes else number
                    on_root(comm, partial(saved_steps.keep, target, first, number))
        except ProcessEnded as error:
            # Data that cannot be used at a time do not take the steps before with them.
            ended = error
        assert last is not None
        last = last if ended is None else last.telling(**ended.entries)
        last = replace(last, probes=tuple(taken.values()))
        file = series.finish() if series else None
        warnings = writing.write(last, target, output, save_state, file)
    if ended is not None:
        raise ended
    if last.converged:
        on_root(comm, lambda: saved_steps.remove(target))
    return last, warnings
