"""A run of a process: each step is saved when it is solved, the results are written at the end.

A run that was killed goes on from its last complete step when it is started again with the same
parameters.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mpi4py import MPI

from contact_locking import study_file
from contact_locking.errors import ProcessEnded
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.process import solving
from contact_locking.process.checkpoint import saved_steps
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.results.output_folder import on_root_of
from contact_locking.results.solution import StudySolution
from contact_locking.running import writing
from contact_locking.study_file.parameters import Parameters


def run_steps(
    parameters: Parameters,
    directory: str | Path,
    comm: MPI.Intracomm = MPI.COMM_WORLD,
    monitor: Monitor | None = None,
    petsc_options: Mapping[str, Any] | None = None,
    restart: str | Path | None = None,
    save_state: bool = False,
) -> tuple[StudySolution, list[str]]:
    """The solution of the last step, its results in ``directory``, and the warnings of writing.

    fields.bp has every step with its time, and history.csv a row for each.  ``restart`` is the
    folder of another process to go on from; without it the run goes on from what an earlier run
    with the same parameters has left in ``directory``.  ``save_state`` adds the checkpoint of the
    last step.  Raises the errors of `solving.solve` and `writing.write`; where data cannot be used
    at a later time, the steps before are written first.  Collective.
    """
    target, listener = Path(directory), monitor or Monitor()
    found: list[Path] = []
    keeps = checkpoint.unavailable() is None
    if keeps:
        name = on_root(comm, lambda: study_file.fingerprint(parameters))
        found = on_root_of(comm, target, lambda: saved_steps.unfinished(target, name))
    if found and restart is None:
        listener.message(f"going on from step {int(found[-1].name)} of an earlier run")
        restart = target
    solutions = solving.solve_steps(parameters, comm, listener, petsc_options, restart)
    last, warnings = _written(parameters, target, solutions, keeps, save_state, comm)
    if last.converged:
        on_root(comm, lambda: saved_steps.remove(target))
    return last, warnings


def _written(
    parameters: Parameters,
    target: Path,
    solutions: Iterator[StudySolution],
    keeps: bool,
    save_state: bool,
    comm: MPI.Intracomm,
) -> tuple[StudySolution, list[str]]:
    """The last of the solutions, and the warnings of writing; ``keeps`` saves each; collective."""
    last: StudySolution | None = None
    with contextlib.ExitStack() as stack:
        series = None
        if parameters.output.fields:
            series = stack.enter_context(writing.FieldSeries(target, comm))
        ended: ProcessEnded | None = None
        try:
            for solution in solutions:
                is_told_again = last is not None and solution.time == last.time
                last = solution
                if is_told_again:
                    continue
                if series is not None:
                    series.add(solution)
                keeps = keeps and checkpoint.has_cells_everywhere(solution.domain)
                if keeps and solution.converged and solution.summary["restart"] is None:
                    _save(solution, target, parameters)
        except ProcessEnded as error:
            # Data that cannot be used at a time do not take the steps before with them.
            ended = error
        assert last is not None
        last = last if ended is None else last.telling(**ended.entries)
        fields = None if series is None else series.finish()
        warnings = writing.write(last, target, save_state, fields)
    if ended is not None:
        raise ended
    return last, warnings


def _save(solution: StudySolution, target: Path, parameters: Parameters) -> None:
    """Save a step; only fields and probes of all steps need the steps before it; collective."""
    number = len(solution.history)
    writing.save_as(solution, target / saved_steps.FOLDER, saved_steps.name_of(number))
    if not parameters.output.fields and not parameters.output.probes:
        on_root(solution.domain.comm, lambda: saved_steps.remove_before(target, number))
