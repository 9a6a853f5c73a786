"""A run of a process: each step is saved when it is solved, the results are written at the end.

A run that was killed goes on from its last complete step when it is started again with the same
parameters.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpi4py import MPI

from contact_locking import study_file
from contact_locking.errors import NoRendering, ProcessEnded
from contact_locking.monitor import Monitor
from contact_locking.parallel import on_root
from contact_locking.process import solving
from contact_locking.process.checkpoint import saved_steps
from contact_locking.process.checkpoint import stored as checkpoint
from contact_locking.results.output_folder import on_root_of
from contact_locking.results.solution import StudySolution
from contact_locking.running import writing
from contact_locking.study_file.parameters import Parameters

if TYPE_CHECKING:
    from contact_locking.view.pictures.animation import Film


class Recording:
    """The film of a run, on rank 0: the bodies of all steps, if it ``is_wanted``."""

    def __init__(self, is_wanted: bool) -> None:
        self._is_wanted = is_wanted
        self._film: Film | None = None
        self._problem: str | None = None

    def add(self, solution: StudySolution) -> None:
        """Add a solved step; collective."""
        if not self._is_wanted or self._problem is not None:
            return
        try:
            from contact_locking.view.pictures.animation import MOST_PIECES, Film, Frame
        except ImportError as error:
            self._problem = f"no animation was drawn: {error.name} cannot be imported"
            return
        from contact_locking.view.pictures.gather import Pieces, gather

        domain = solution.domain
        in_cell = len(Pieces.of(domain.kind, solution.element.degree).nodes)
        if in_cell * domain.num_cells > MOST_PIECES[domain.dim]:
            most = MOST_PIECES[domain.dim] // in_cell
            self._problem = f"no animation was drawn: it is for at most {most} such cells"
            return
        self._film = self._film or Film()
        body = gather(solution)
        if body is not None:
            self._film.add(Frame(len(solution.history), solution.time, body))

    def finish(self, comm: MPI.Intracomm, monitor: Monitor) -> tuple[bytes | None, str | None]:
        """The GIF file on rank 0, and why there is none if there should be one; collective."""
        drawn: bytes | None = None
        if self._film is not None and len(self._film.frames) > 1:
            from contact_locking.view.pictures.animation import animation

            monitor.message("drawing the animation")
            try:
                drawn = animation(self._film.frames)
            except NoRendering as reason:
                self._problem = f"no animation was drawn: {reason}"
            except Exception as error:
                # An error of the animation must not lose the results of a long process.
                self._problem = f"no animation was drawn: {type(error).__name__}: {error}"
        return drawn, comm.bcast(self._problem, root=0)


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

    fields.bp has every step with its time, history.csv a row for each, and animation.gif a frame
    for each, or for some of many.  ``restart`` is the folder
    of another process to go on from; without it the run goes on from what an earlier run with the
    same parameters has left in ``directory``.  ``save_state`` adds the checkpoint of the last step.
    Raises the errors of `solving.solve` and `writing.write`; where data cannot be used at a later
    time, the steps before are written first.  Collective.
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
    last, warnings = _written(parameters, target, solutions, keeps, save_state, listener, comm)
    if last.converged:
        on_root(comm, lambda: saved_steps.remove(target))
    return last, warnings


def _written(
    parameters: Parameters,
    target: Path,
    solutions: Iterator[StudySolution],
    keeps: bool,
    save_state: bool,
    monitor: Monitor,
    comm: MPI.Intracomm,
) -> tuple[StudySolution, list[str]]:
    """The last of the solutions, and the warnings of writing; ``keeps`` saves each; collective."""
    last: StudySolution | None = None
    with contextlib.ExitStack() as stack:
        series = None
        if parameters.output.fields:
            series = stack.enter_context(writing.FieldSeries(target, comm))
        film = Recording(parameters.output.animation and parameters.output.picture)
        ended: ProcessEnded | None = None
        try:
            for solution in solutions:
                is_told_again = last is not None and solution.time == last.time
                last = solution
                if is_told_again:
                    continue
                if series is not None:
                    series.add(solution)
                film.add(solution)
                keeps = keeps and checkpoint.has_cells_everywhere(solution.domain)
                if keeps and solution.converged and solution.summary["restart"] is None:
                    _save(solution, target, parameters)
        except ProcessEnded as error:
            # Data that cannot be used at a time do not take the steps before with them.
            ended = error
        assert last is not None
        last = last if ended is None else last.telling(**ended.entries)
        fields = None if series is None else series.finish()
        animation, problem = film.finish(comm, monitor)
        if problem is not None:
            last = last.telling(warnings=[*last.summary["warnings"], problem])
        warnings = writing.write(last, target, save_state, fields, animation)
    if ended is not None:
        raise ended
    return last, warnings


def _save(solution: StudySolution, target: Path, parameters: Parameters) -> None:
    """Save a step; only fields and probes of all steps need the steps before it; collective."""
    number = len(solution.history)
    writing.save_as(solution, target / saved_steps.FOLDER, saved_steps.name_of(number))
    if not parameters.output.fields and not parameters.output.probes:
        on_root(solution.domain.comm, lambda: saved_steps.remove_before(target, number))
