"""The texts that the command line prints, once, from rank 0, and the process: MPI and signals."""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import os
import pwd
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from contact_locking.errors import ContactLockingError, InputError
from contact_locking.plain_text import count, printable
from contact_locking.solver.monitor import Monitor

if TYPE_CHECKING:
    from mpi4py import MPI


# Variables by which launchers tell a process that it may be one of several.
_LAUNCHERS = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK", "MPI_LOCALNRANKS")
# Where only some ranks may have failed, rank 0 has this time to speak before the others do.
_GRACE_SECONDS = 1.0


def world() -> MPI.Intracomm | None:
    """All processes, or None for one alone; MPI is imported only if there may be others."""
    if "mpi4py.MPI" not in sys.modules and not _is_launched():
        return None
    from mpi4py import MPI

    return MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None


def _is_launched() -> bool:
    return any(name in os.environ for name in _LAUNCHERS)


def is_root() -> bool:
    """Whether this is rank 0, or the only process."""
    comm = world()
    return comm is None or comm.rank == 0


def complain(text: str) -> None:
    """Print to standard error, from rank 0; lines after the first are indented."""
    if is_root():
        head, *lines = printable(text).split("\n")
        print("\n".join([head, *(f"       {line}" for line in lines)]), file=sys.stderr, flush=True)


class LastingOutput(io.FileIO):
    """Standard output of a program that solves on where it cannot be written to.

    One line on standard error tells of the first refusal, such as that of a full disk, and what
    follows is left out.  A reader that has left is no refusal: BrokenPipeError passes.
    """

    refused = False

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except BrokenPipeError:
            raise
        except OSError as error:
            self.refused = True
            complain(
                f"error: standard output cannot be written to: {error.strerror}; it is left out"
            )
            os.dup2(os.open(os.devnull, os.O_WRONLY), self.fileno())
            return memoryview(data).nbytes


def lasting_output() -> LastingOutput:
    """Standard output as `LastingOutput`, and what the caller closed as an output to nowhere.

    A descriptor of standard output that stayed closed would be that of the next file, such as one
    of results.
    """
    while (spare := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    os.close(spare)
    raw, before = LastingOutput(1, "w", closefd=False), sys.stdout
    sys.stdout = io.TextIOWrapper(
        io.BufferedWriter(raw),
        encoding=getattr(before, "encoding", None),
        errors=getattr(before, "errors", None),
        line_buffering=getattr(before, "line_buffering", True),
        write_through=getattr(before, "write_through", False),
    )
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    return raw


def leave_together() -> None:
    """Wait for all ranks, as a launcher ends the others when one leaves with an error."""
    sys.stdout.flush()
    comm = world()
    if comm is not None:
        comm.Barrier()


def abort(code: int, text: str, error: BaseException | None = None) -> int:
    """Print the reason and end all ranks, of which perhaps only this one has failed.

    Returns ``code`` for a single process.  Prints the traceback of ``error`` if given.
    """
    comm = world()
    if comm is not None and comm.rank > 0:
        # If rank 0 has failed as well, it prints its reason, and its abort ends this wait.
        time.sleep(_GRACE_SECONDS)
        text = f"{text} (on rank {comm.rank})"
    # Writing to a closed terminal raises OSError.
    with contextlib.suppress(OSError):
        if error is not None:
            traceback.print_exception(error)
        print(printable(text), file=sys.stderr, flush=True)
        sys.stdout.flush()
    if comm is not None:
        comm.Abort(code)
    return code


def columns(rows: Sequence[Sequence[str]]) -> str:
    """A table without rules, each column as wide as its longest entry."""
    rows = [[printable(text, keep="") for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(f"{text:{width}}" for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )


# PETSc's codes for an argument that is wrong, out of range, wrong input, of unknown type.
_OPTION_ERRORS = (62, 63, 83, 86)

# The options of DOLFINx and of FFCx, which both take from the current folder too.
_OPTION_FILES = ("dolfinx_jit_options.json", "ffcx_options.json")


def world_with_dolfinx(arguments: argparse.Namespace) -> MPI.Intracomm:
    """MPI's world, with PETSc initialised without the command line's words and petscrc files.

    Raises InputError for environment variables with which MPI would abort.
    """
    _prepare_environment()
    try:
        import petsc4py

        # PETSc's signal handlers would report a crash where a process is asked to end.
        with kept(signal.SIGPIPE):
            # A petscrc file in the folder of a study may hold options that run code.  The options
            # in PETSC_OPTIONS are the user's own.
            petsc4py.init(["contact-locking", "-skip_petscrc"])
            import dolfinx.fem.petsc  # noqa: F401
            from mpi4py import MPI
    except ImportError as error:
        raise ContactLockingError(
            f"DOLFINx cannot be imported here: {error}\n"
            "It needs DOLFINx 0.9 or newer with PETSc; the README says how to get it."
        ) from error
    # If the reader of the output leaves early, as head does, a program of one process ends in
    # silence, whether Python or a monitor of PETSc was printing.
    if arguments.program and MPI.COMM_WORLD.size == 1:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    for name in ignore_current_folder():
        complain(
            f"warning: {name} in this folder is ignored, as options of a compiler can run code; "
            "the folder of your configuration is the place for it: ~/.config/dolfinx or ffcx"
        )
    return MPI.COMM_WORLD


def ignore_current_folder() -> list[str]:
    """Let DOLFINx and FFCx take options from the user's configuration, not from this folder.

    Options of the compiler can run code, and a folder with a study may come from anybody.  Returns
    the names of the files that are ignored.  Call this function before anything is compiled.
    """
    import ffcx.options
    from dolfinx import jit

    ignored = [name for name in _OPTION_FILES if Path(name).exists()]
    # Both read their files once.
    with contextlib.chdir("/"):
        jit.get_options()
        ffcx.options.get_options()
    return ignored


def _prepare_environment() -> None:
    """Give MPI a home, which cron and systemd leave out, and refuse a TMPDIR that is none."""
    if not os.environ.get("HOME"):
        os.environ["HOME"] = pwd.getpwuid(os.getuid()).pw_dir
    folder = os.environ.get("TMPDIR")
    if folder and not (os.path.isdir(folder) and os.access(folder, os.W_OK)):
        raise InputError(
            f"TMPDIR: {folder} cannot be written to; create the folder, or unset TMPDIR"
        )


@contextlib.contextmanager
def petsc_complaints() -> Iterator[None]:
    """Turn an error of PETSc about an option into InputError."""
    from petsc4py import PETSc

    try:
        yield
    except PETSc.Error as error:
        if error.ierr not in _OPTION_ERRORS:
            raise
        raise InputError(f"PETSc refuses an option: {str(error).splitlines()[-1]}") from error


# After so many seconds without a line an iteration prints one.
_SILENCE = 5.0


def say(text: str) -> None:
    """Print a line."""
    print(printable(text), flush=True)


class TerminalMonitor(Monitor):
    """A line for each message, stage, friction update and mesh.

    Stages that take longer have further lines, which show that the solve goes on.
    """

    def __init__(self) -> None:
        # Adapted meshes repeat warnings.
        self._complain_once = functools.cache(complain)
        self._step = self._stage = ""
        self._iterations = self._krylov = 0
        # Tangents and friction updates of the solve, and those of the stages before this one.
        self._counts = self._before = (0, 0)
        # None before the first iteration of a stage.
        self._residual: float | None = None
        self._began = self._printed = time.perf_counter()

    def message(self, text: str) -> None:
        if text.startswith("warning"):
            self._complain_once(text)
            return
        self.finish()
        self._line(text)

    def step(self, number: int, remaining: int, time: float) -> None:
        self.finish()
        self._step = f"step {number}  t = {time:.6g}  ({remaining} to do)  "

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        self.finish()
        if index == 1:  # each solve counts from zero
            self._counts = self._before = (0, 0)
        of = f"/{count_estimate}" if index <= count_estimate else ""
        self._stage = f"{self._step}stage {index}{of}  n = {n:.3g}  epsilon = {epsilon:.3g}"
        self._iterations, self._krylov, self._residual = 0, 0, None
        self._began = time.perf_counter()

    def friction_update(self, k: int, change: float, factor: float | None) -> None:
        rate = "" if factor is None else f", contraction {factor:.2f}"
        self._line(f"  friction update {k}: change {change:.1e}{rate}")

    def iteration(self, k: int, residual: float) -> None:
        # Iteration 0 begins a further solve within the stage.
        self._iterations += k > 0
        self._residual = residual
        self._show_life()

    def linear(self, k: int) -> None:
        # Iteration 0 begins a further linear solve.
        self._krylov += k > 0
        self._show_life()

    def mesh(self, number: int, text: str) -> None:
        self.finish()
        self._line(f"mesh {number}: {text}")

    def counted(self, tangents: int, friction_updates: int) -> None:
        self._counts = (tangents, friction_updates)

    def finish(self) -> None:
        if not self._stage:
            return
        (tangents, updates), (last_tangents, last_updates) = self._counts, self._before
        counts = count(tangents - last_tangents, "tangent")
        if updates > last_updates:
            counts += f", {count(updates - last_updates, 'friction update')}"
        seconds = time.perf_counter() - self._began
        self._line(f"{self._stage}  {counts}{self._residual_in_words()}, {seconds:.1f} s")
        self._stage, self._before = "", self._counts

    def _show_life(self) -> None:
        """Print how far the stage is, where nothing has been printed for long."""
        now = time.perf_counter()
        if now - self._printed < _SILENCE or not self._stage:
            return
        krylov = f", {count(self._krylov, 'Krylov iteration')}" if self._krylov else ""
        done = f"iteration {self._iterations}{self._residual_in_words()}{krylov}"
        self._line(f"  {self._stage}  {done}, {now - self._began:.0f} s")

    def _residual_in_words(self) -> str:
        return "" if self._residual is None else f", residual {self._residual:.1e}"

    def _line(self, text: str) -> None:
        self._printed = time.perf_counter()
        say(text)


_ENDING = (signal.SIGTERM, signal.SIGHUP)


class Stopped(KeyboardInterrupt):
    """A signal other than that of Ctrl-C asked the process to end."""

    def __init__(self, number: int) -> None:
        self.signal = signal.Signals(number)
        super().__init__(f"stopped by {self.signal.name}")


@contextlib.contextmanager
def stoppable(at_once: Callable[[KeyboardInterrupt], None] | None = None) -> Iterator[None]:
    """Raise Stopped at SIGTERM, and at SIGHUP, which a terminal sends when it is closed.

    ``at_once`` is called before, also at Ctrl-C, and may end the process.  An ignored signal, such
    as SIGHUP under nohup, stays ignored.
    """
    handled = (*_ENDING, signal.SIGINT) if at_once is not None else _ENDING

    def stop(number: int, frame: FrameType | None) -> None:
        # A second signal must not interrupt the cleaning up; SIGKILL still ends the process.
        for ending in _ENDING:
            signal.signal(ending, signal.SIG_IGN)
        interrupt = KeyboardInterrupt() if number == signal.SIGINT else Stopped(number)
        if at_once is not None:
            at_once(interrupt)
        raise interrupt

    before = {number: signal.getsignal(number) for number in handled}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def kept(*others: signal.Signals) -> Iterator[None]:
    """Restore the handlers of ``others``, SIGTERM and SIGHUP that a library may replace."""
    before = {number: signal.getsignal(number) for number in (*_ENDING, *others)}
    try:
        yield
    finally:
        for number, handler in before.items():
            # None stands for a handler that was not installed from Python.
            if handler is not None:
                signal.signal(number, handler)


def exit_code(interrupt: KeyboardInterrupt) -> int:
    """128 plus the number of the signal: the exit code that a shell gives for an ended process."""
    number = interrupt.signal if isinstance(interrupt, Stopped) else signal.SIGINT
    return 128 + int(number)
