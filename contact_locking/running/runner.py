"""Solve the unfinished cases of a study, J at a time, and write the table of all cases."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

from contact_locking import study_file
from contact_locking.errors import NoRoom, explained, tells_of_full_disk
from contact_locking.files.atomic import locked, make_folders, remove_abandoned, write_text
from contact_locking.plain_text import duration, printable
from contact_locking.results.folder import (
    KEY,
    PARAMETERS,
    TABLE_CSV,
    TABLE_LINES,
    not_writable,
    require_own,
)
from contact_locking.running.cases import (
    LOG,
    Case,
    Outcome,
    State,
    cases_of,
    conclude,
    each_once,
    outcome,
    row_of,
    write_rows,
)
from contact_locking.running.executor import Executor, Plan, Slot, end_of, launcher
from contact_locking.running.signals import stoppable
from contact_locking.study_file import StudyFile
from contact_locking.study_file.parameters import Parameters

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


INDEX = "index.txt"
_TABLE_SECONDS = 2.0
_PAUSE_SECONDS = 0.05
_GO_ON = "Finished cases are kept; make room, and repeat the command for the others."


class Study:
    """The cases of a file, and the outcome of each under its name, as their folder has them."""

    def __init__(self, directory: Path, cases: list[Case]) -> None:
        self.directory, self.cases = directory, cases
        self.look()

    @classmethod
    def of(cls, file: StudyFile) -> Study:
        """The study of a file. Raises InputError."""
        return cls(Path(file.parameters.output.directory), cases_of(file))

    def look(self) -> None:
        """Read the outcome of each case from its folder."""
        self.outcomes: dict[str, Outcome] = {
            case.name: outcome(case) for case in each_once(self.cases)
        }

    @property
    def unfinished(self) -> list[Case]:
        return [case for case in each_once(self.cases) if not self.outcomes[case.name].finished]

    def count(self) -> Counter[State]:
        """The cases in each state."""
        return Counter(self.outcomes[case.name].state for case in self.cases)

    @property
    def finished(self) -> int:
        return sum(self.outcomes[case.name].finished for case in self.cases)

    def write_table(self) -> None:
        """Write the table of all cases. Raises OSError."""
        rows = [row_of(case.values, case.name, self.outcomes[case.name]) for case in self.cases]
        write_rows(self.directory, rows)


def finish(study: Study, parameters: Parameters, plan: Plan, console: Console) -> None:
    """Solve the unfinished cases, and write the table of all cases beside ``parameters``.

    Raises InputError for a folder that cannot be written to or that another study or run is using,
    and if mpirun is missing; ContactLockingError if the disk is full.
    """
    launcher(plan.ranks)
    directory = study.directory
    with explained(not_writable(directory), directory, KEY, _GO_ON):
        make_folders(directory / "cases")
        with locked(directory, "study") as held:
            # Another study may have finished cases until this one got the lock.
            study.look()
            todo = study.unfinished
            with View(console, len(todo)) as view:
                if not held:
                    view.line(f"warning: the file system of {directory} has no locks", "yellow")
                require_own(directory, (PARAMETERS, TABLE_CSV, TABLE_LINES))
                cases, before = study.cases, study.finished
                words = f", {before} finished before" if before else ""
                view.line(f"{len(cases)} cases in {directory}{words}")
                asked, cores = plan.jobs * plan.ranks, os.cpu_count() or 1
                if asked > cores:
                    words = (
                        f"{asked} processes share the {cores} cores of this machine, and are slow"
                    )
                    view.line(f"warning: {words}", "yellow")
                if repeated := len(cases) - len(study.outcomes):
                    words = f"{repeated} repeat the values of others, and are solved once"
                    view.line(f"warning: {words}", "yellow")
                for folder in (directory, directory / "cases"):
                    remove_abandoned(folder)
                write_text(directory / PARAMETERS, study_file.dump(parameters))
                lines = [f"{case.name}  {case.label}\n" for case in cases]
                write_text(directory / "cases" / INDEX, "".join(lines))
                study.write_table()
                try:
                    _solve(study, todo, plan, view)
                except KeyboardInterrupt:
                    of = f"{study.finished} of {len(study.cases)}"
                    view.line(f"{of} cases are finished; the same command does the others")
                    raise


def _solve(study: Study, todo: Sequence[Case], plan: Plan, view: View) -> None:
    """Run the cases; write the table of the finished cases also if an error ends this."""
    executor = Executor(todo, plan)
    written = time.monotonic()
    try:
        with stoppable():
            while executor.busy:
                for ended in executor.poll():
                    result = conclude(ended.case, ended.why)
                    study.outcomes[ended.case.name] = result
                    view.ended(ended.case, result, ended.seconds)
                    if tells_of_full_disk(result.reason):
                        raise NoRoom(f"{result.reason}\n{_GO_ON}")
                if time.monotonic() > written + _TABLE_SECONDS:
                    study.write_table()
                    written = time.monotonic()
                executor.start()
                view.show(executor.running)
                time.sleep(_PAUSE_SECONDS)
    finally:
        executor.stop()
        study.look()
        study.write_table()


def summary_rows(study: Study, seconds: float) -> list[tuple[str, str]]:
    """The number of cases in each state, the time and the place of the table."""
    count = study.count()
    rows: list[tuple[str, str]]
    rows = [(state, str(number)) for state, number in sorted(count.items()) if number]
    if warned := sum(bool(study.outcomes[case.name].warnings) for case in study.cases):
        rows.append(("with warnings", str(warned)))
    return [*rows, ("time", duration(seconds)), ("table in", str(study.directory / TABLE_CSV))]


_STYLES: dict[State, str] = {"not converged": "yellow", "failed": "red"}


class View:
    """Shows the cases that run and that have ended; use it as a context manager.

    ``total`` is the number of cases to be solved.
    """

    def __init__(self, console: Console, total: int) -> None:
        from rich.live import Live

        self._console = console
        self._total = total
        self._states: Counter[State] = Counter()
        self._live: Live | None = None
        if console.is_terminal:
            # No thread refreshes the display, because this process forks others.
            self._live = Live(console=console, auto_refresh=False, transient=True)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def line(self, text: str, style: str | None = None) -> None:
        """Print a line that stays on the terminal."""
        from rich.text import Text

        self._console.print(Text(printable(text)), style=style, soft_wrap=True)

    def ended(self, case: Case, outcome: Outcome, seconds: float) -> None:
        self._states[outcome.state] += 1
        width = len(str(self._total))
        reason = f": {outcome.reason}" if outcome.state != "converged" else outcome.reservation
        self.line(
            f"[{self._states.total():{width}}/{self._total}] {case.label}  "
            f"{outcome.state}{reason}  ({duration(seconds)})",
            _STYLES.get(outcome.state),
        )
        for warning in outcome.warnings:
            self.line(f"{'':{2 * width + 3}} warning: {warning}", "yellow")

    def show(self, running: Sequence[Slot]) -> None:
        """Refresh the display of the running cases."""
        if self._live is not None:
            self._live.update(self._picture(running), refresh=True)

    def _picture(self, running: Sequence[Slot]) -> Table:
        from rich.table import Table
        from rich.text import Text

        done = self._states.total()
        counts = [f"{done} of {self._total} done", f"{len(running)} running"]
        counts += [f"{self._states[state]} {state}" for state in _STYLES if self._states[state]]
        outer = Table.grid()
        outer.add_row(Text(", ".join(counts), style="bold"))
        inner = Table.grid(padding=(0, 2))
        for slot in running:
            last = end_of(slot.case.folder / LOG).strip().rpartition("\n")[2] or "starting"
            cells = (slot.case.label, last.strip(), duration(slot.seconds))
            inner.add_row(*(Text(f"  {printable(cell)}", no_wrap=True) for cell in cells))
        outer.add_row(inner)
        return outer
