"""Solve the unfinished cases of a study, J at a time, and write the table of all cases.

A case is a process of this machine, of one rank or of several under mpirun.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from contact_locking import study_file
from contact_locking.errors import (
    ContactLockingError,
    InputError,
    NoRoom,
    explained,
    reports_full_disk,
)
from contact_locking.files import locked, make_folders, remove_abandoned, write_text
from contact_locking.plain_text import duration
from contact_locking.results.output import (
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
    begin,
    cases_of,
    conclude,
    each_once,
    outcome,
    row_of,
    write_rows,
)
from contact_locking.study_file import StudyFile
from contact_locking.study_file.parameters import Parameters

#: The program that solves a case; its arguments follow.  With -P, Python takes no modules from the
#: current folder, which may have come with the study.
PROGRAM = (sys.executable, "-P", "-m", "contact_locking")
INDEX = "index.txt"
#: Takes a line about the study.
Say = Callable[[str], None]

_LOG_TAIL = 65_536
# An error as the command line prints it: its further lines are indented.
_ERROR = re.compile(r"^error: (.+(?:\n {7}.+)*)", re.MULTILINE)
# PETSc catches signals, prints this message and ends with an exit code of its own.
_CRASH = re.compile(r"PETSC ERROR: Caught signal number \d+ ([^,\n]+)")
# mpirun has this time to end its ranks.
_GRACE_SECONDS = 10.0
_PR_SET_PDEATHSIG = 1
_TABLE_SECONDS, _PAUSE_SECONDS = 2.0, 0.05
_GO_ON = "Finished cases are kept; make room, and repeat the command for the others."


@dataclass(frozen=True)
class Plan:
    """How many cases are solved at a time, on how many ranks each, and by which program."""

    jobs: int = 1
    ranks: int = 1
    program: Sequence[str] = PROGRAM

    @property
    def launcher(self) -> tuple[str, ...]:
        """The words before the program.  Raises InputError if there is no mpirun."""
        if self.ranks == 1:
            return ()
        mpirun = shutil.which("mpirun")
        if mpirun is None:
            raise InputError(
                f"--ranks {self.ranks} takes mpirun, which is not on the PATH; "
                "install MPI, or leave --ranks out"
            )
        return (mpirun, "-n", str(self.ranks))

    @property
    def environment(self) -> dict[str, str]:
        """The environment variables of the cases; variables that the user has set stay."""
        defaults = {"PYTHONUNBUFFERED": "1"}
        if self.jobs * self.ranks > 1:
            defaults["OMP_NUM_THREADS"] = "1"
        if self.jobs > 1 and self.ranks > 1:
            # Each mpirun of Open MPI 4 and 5 would bind its ranks to the same first cores.
            defaults["OMPI_MCA_hwloc_base_binding_policy"] = "none"
            defaults["PRTE_MCA_hwloc_default_binding_policy"] = "none"
        return defaults | os.environ


class RunningCase:
    """A case in a process, which on Linux ends with this one, in whatever way this one ends.

    The constructor raises ContactLockingError, and OSError for a folder that cannot be prepared.
    """

    def __init__(self, case: Case, plan: Plan) -> None:
        begin(case)
        self.case, self._began, self._log = case, time.monotonic(), case.folder / LOG
        program = [*plan.launcher, *plan.program, "run", str(case.folder / PARAMETERS)]
        # A killed mpirun could not end its ranks; SIGTERM makes mpirun end them.
        end = signal.SIGTERM if plan.ranks > 1 else signal.SIGKILL
        with self._log.open("wb") as stream:
            try:
                # Ctrl-C on the terminal reaches this process only, which then stops the cases.
                self._process = subprocess.Popen(
                    program,
                    env=plan.environment,
                    stdin=subprocess.DEVNULL,
                    stdout=stream,
                    stderr=subprocess.STDOUT,
                    process_group=0,
                    preexec_fn=_tied(end),
                )
            except OSError as error:
                message = f"a case cannot be started: {program[0]}: {error.strerror}"
                raise ContactLockingError(message) from error

    @property
    def seconds(self) -> float:
        return time.monotonic() - self._began

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def why(self) -> str:
        """The reason why it has ended without results, also from its log."""
        code = self._process.returncode
        number = -code if code < 0 else code - 128
        if number in list(signal.Signals):
            name = signal.Signals(number).name
            hint = ", perhaps out of memory" if number == signal.SIGKILL else ""
            return f"was killed by {name}{hint}"
        with self._log.open("rb") as stream:
            stream.seek(max(0, self._log.stat().st_size - _LOG_TAIL))
            text = stream.read().decode("utf-8", errors="replace")
        if code and (crash := _CRASH.search(text)):
            return f"crashed: {crash[1]}; see {self._log}"
        if code and (errors := _ERROR.findall(text)):
            return " ".join(errors[-1].split())
        if code in (0, 3):
            return "has no results for these parameters; did the mesh file change meanwhile?"
        return f"ended with exit code {code}; see {self._log}"

    def send(self, number: signal.Signals) -> None:
        """Send a signal to the process and its children, also after the process has ended."""
        # macOS raises PermissionError for a process that has ended.
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, number)


def _tied(end: signal.Signals) -> Callable[[], None] | None:
    """Code for a child process: the system sends ``end`` to the child when this process ends."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is None:
        return None
    parent = os.getpid()

    def tie() -> None:
        prctl(_PR_SET_PDEATHSIG, int(end))
        if os.getppid() != parent:
            os._exit(1)

    return tie


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

    def rows(self, seconds: float) -> list[tuple[str, str]]:
        """The number of cases in each state, the time and the place of the table."""
        rows = [(str(state), str(count)) for state, count in sorted(self.count().items()) if count]
        if warned := sum(bool(self.outcomes[case.name].warnings) for case in self.cases):
            rows.append(("with warnings", str(warned)))
        return [*rows, ("time", duration(seconds)), ("table in", str(self.directory / TABLE_CSV))]


def finish(study: Study, parameters: Parameters, plan: Plan, say: Say) -> None:
    """Solve the unfinished cases, and write the table of all cases beside ``parameters``.

    Raises InputError for a folder that cannot be written to or that another study or run is using,
    and if mpirun is missing; ContactLockingError if the disk is full.
    """
    directory, _ = study.directory, plan.launcher
    with explained(not_writable(directory), directory, KEY, _GO_ON):
        make_folders(directory / "cases")
        with locked(directory, "study") as held:
            # Another study may have finished cases until this one got the lock.
            study.look()
            if not held:
                say(f"warning: the file system of {directory} has no locks")
            require_own(directory, (PARAMETERS, TABLE_CSV, TABLE_LINES))
            cases, before = study.cases, study.finished
            words = f", {before} finished before" if before else ""
            say(f"{len(cases)} cases in {directory}{words}")
            asked, cores = plan.jobs * plan.ranks, os.cpu_count() or 1
            if asked > cores:
                say(f"warning: {asked} processes share {cores} cores, and are slow")
            if repeated := len(cases) - len(study.outcomes):
                say(f"warning: {repeated} repeat the values of others, and are solved once")
            for folder in (directory, directory / "cases"):
                remove_abandoned(folder)
            write_text(directory / PARAMETERS, study_file.dump(parameters))
            lines = [f"{case.name}  {case.label}\n" for case in cases]
            write_text(directory / "cases" / INDEX, "".join(lines))
            study.write_table()
            try:
                _solve(study, plan, say)
            except KeyboardInterrupt:
                of = f"{study.finished} of {len(study.cases)}"
                say(f"{of} cases are finished; the same command does the others")
                raise


def _solve(study: Study, plan: Plan, say: Say) -> None:
    """Run the cases; write the table of the finished cases also if an error ends this."""
    waiting, running, written = study.unfinished[::-1], list[RunningCase](), time.monotonic()
    total, width = len(waiting), len(str(len(waiting)))
    try:
        while waiting or running:
            for ended in [each for each in running if each.has_ended]:
                running.remove(ended)
                case, result = ended.case, conclude(ended.case, ended.why)
                study.outcomes[case.name] = result
                number = total - len(waiting) - len(running)
                reason = f": {result.reason}" if result.state != "converged" else result.reservation
                of = f"[{number:{width}}/{total}] {case.label}"
                say(f"{of}  {result.state}{reason}  ({duration(ended.seconds)})")
                for warning in result.warnings:
                    say(f"{'':{2 * width + 3}} warning: {warning}")
                if reports_full_disk(result.reason):
                    raise NoRoom(f"{result.reason}\n{_GO_ON}")
            if time.monotonic() > written + _TABLE_SECONDS:
                study.write_table()
                written = time.monotonic()
            while waiting and len(running) < plan.jobs:
                running.append(RunningCase(waiting.pop(), plan))
            time.sleep(_PAUSE_SECONDS)
    finally:
        _stop(running)
        study.look()
        study.write_table()


def _stop(running: Sequence[RunningCase]) -> None:
    """Ask cases to end, and kill those that do not end in time."""
    for case in running:
        case.send(signal.SIGTERM)
    deadline = time.monotonic() + _GRACE_SECONDS
    try:
        while not all(case.has_ended for case in running) and time.monotonic() < deadline:
            time.sleep(0.02)
    finally:
        # Also if the wait was interrupted.
        for case in running:
            case.send(signal.SIGKILL)
