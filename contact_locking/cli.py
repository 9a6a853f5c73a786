"""The command ``contact-locking``.

Exit codes: 0 converged, 1 an unexpected error, 2 bad input, 3 not converged, 130 interrupted.
What a command needs is imported when it runs: help and schema are there at once, and a file
that is wrong is found wrong without DOLFINx.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contact_locking import terminal
from contact_locking.arguments import parse
from contact_locking.errors import ContactLockingError, InputError, not_written

if TYPE_CHECKING:
    from mpi4py import MPI

    from contact_locking.solution import Solution
    from contact_locking.study_file import StudyFile

CONVERGED, UNEXPECTED, NOT_CONVERGED, INTERRUPTED = 0, 1, 3, 130

# PETSc's codes for an argument that is wrong, out of range, wrong input, of unknown type.
_OPTION_ERRORS = (62, 63, 83, 86)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; no exception leaves it.

    ``argv`` are the words after the program's name, those it was started with by default.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    try:
        code = _run_command(words, program=argv is None)
    except ContactLockingError as error:
        # All ranks have raised it.
        terminal.complain(f"error: {error}")
        code = error.exit_code
    except SystemExit as stop:  # argparse, after --help and --version
        code = int(stop.code or 0)
    except KeyboardInterrupt:
        return terminal.abort(INTERRUPTED, "interrupted")
    except BrokenPipeError:
        # Nobody reads the output any more; let the interpreter flush it to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNEXPECTED
    except Exception as error:
        text, hint = _unexpected(error)
        if "--debug" in words:
            return terminal.abort(UNEXPECTED, text, error)
        return terminal.abort(UNEXPECTED, f"{text}\n{hint}")
    terminal.leave_together()
    return code


def run(arguments: argparse.Namespace) -> int:
    """Solve, write the results, and say what came out."""
    study = _load(arguments.file, _overrides(arguments))
    comm = _world_with_dolfinx(arguments)
    from contact_locking import checkpoint, output, problem
    from contact_locking.progress import Monitor, ProgressFile, TerminalMonitor

    parameters = study.parameters
    directory = parameters.output.directory
    speaks = comm.rank == 0 and not arguments.quiet
    listening: contextlib.AbstractContextManager[Monitor] = (
        TerminalMonitor(terminal.console()) if speaks else contextlib.nullcontext(Monitor())
    )
    if arguments.restart is not None and not arguments.checkpoint:
        _keep_checkpoint(arguments.restart, Path(directory))
    with _explained(study):
        output.prepare(directory, comm)
        if arguments.checkpoint and (missing := checkpoint.unavailable()) is not None:
            terminal.complain(f"warning: no checkpoint will be saved: {missing}")
            arguments.checkpoint = False
        if speaks and parameters.study is not None:
            print("The file describes a study; run solves its base case.")
        with listening as monitor, _petsc_complaints():
            if arguments.progress is not None and comm.rank == 0:
                monitor = ProgressFile(arguments.progress, monitor)
            solution = problem.solve(parameters, comm, monitor, arguments.petsc, arguments.restart)
        warnings = output.write(solution, directory, arguments.checkpoint)
    if arguments.quiet:
        warnings = [*solution.summary["warnings"], *warnings]
    for warning in warnings:
        terminal.complain(f"warning: {warning}")
    ratio = _largest_strain_ratio(solution)
    if speaks:
        rows = terminal.summary_rows(solution.summary, ratio, directory)
        print(terminal.two_columns(rows))
    if solution.converged:
        return CONVERGED
    reason, way_out = solution.summary["reason"], solution.summary["suggestion"]
    lines = (f"not converged: {reason}", way_out, f"What was reached is in {directory}.")
    terminal.complain("error: " + "\n".join(line for line in lines if line))
    return NOT_CONVERGED


def study(arguments: argparse.Namespace) -> int:
    """Solve every case of a study that is not finished, and write the table of all."""
    if terminal.world() is not None:
        raise InputError("start a study without mpirun: --ranks K runs each case on K ranks")
    began = time.perf_counter()
    file = _load(arguments.file, _overrides(arguments))
    from contact_locking import studies

    plan = studies.Plan(arguments.jobs, arguments.ranks, arguments.executor)
    with _explained(file):
        done = studies.run(file, plan, terminal.console())
    rows = studies.summary_rows(done, time.perf_counter() - began)
    print(terminal.two_columns(rows))
    return CONVERGED if set(done.count()) == {"converged"} else NOT_CONVERGED


def report(arguments: argparse.Namespace) -> int:
    """Write the page and the charts of a finished run or study."""
    from contact_locking import report as reports

    if terminal.is_root():
        try:
            print(f"{reports.write(arguments.directory)}: written")
        except ImportError as error:
            raise ContactLockingError(f"a report takes Matplotlib: {error}") from error
    return 0


def view(arguments: argparse.Namespace) -> int:
    """Show the result of a run in a window until that is closed."""
    from contact_locking import viewer

    if terminal.is_root():
        try:
            viewer.view(arguments.directory)
        except ImportError as error:
            raise ContactLockingError(f"a window takes Matplotlib: {error}") from error
    return 0


def check(arguments: argparse.Namespace) -> int:
    """Say what is wrong or what would run, and solve nothing."""
    study = _load(arguments.file, arguments.set)
    parameters = study.parameters
    comm = _world_with_dolfinx(arguments)
    from contact_locking import groups, output, problem

    with _explained(study):
        output.prepare(parameters.output.directory, comm)
        facts = problem.check(parameters, comm)
    for warning in facts.pop("warnings"):
        terminal.complain(f"warning: {warning}")
    if comm.rank == 0:
        rows = [("mesh", parameters.mesh.file or str(parameters.mesh.builder))]
        table, held = facts.pop("groups"), facts.pop("held by")
        del facts["regions"], facts["boundary parts"]  # which the table has
        rows += [(name, _shown(value)) for name, value in facts.items()]
        rows += [(f"{part} is held by", words) for part, words in held.items()]
        if parameters.study is not None:
            from contact_locking import studies

            cases = studies.Study.of(study)
            finished = f"{cases.finished} finished in {cases.directory}"
            rows.append(("cases of the study", f"{len(cases.cases)}, {finished}"))
        print(f"{arguments.file} can be run:\n{terminal.two_columns(rows)}\n")
        print(terminal.columns(groups.table(table)))
    return 0


def mesh(arguments: argparse.Namespace) -> int:
    """Write the mesh of the study file's builder."""
    study = _load(arguments.file, arguments.set)
    geometry = study.parameters.mesh.geometry
    if geometry is None:
        raise InputError(
            study.explain(InputError("the mesh is a file already, nothing is built", "mesh.file"))
        )
    from contact_locking import meshes

    if terminal.is_root():
        try:
            meshes.write(geometry, arguments.output)
        except ImportError as error:
            raise ContactLockingError(f"Gmsh cannot be imported: {error}") from error
        except OSError as error:
            place = arguments.output
            raise not_written(f"cannot write {place}", error, place) from error
        except (ValueError, RuntimeError) as error:
            raise InputError(str(error)) from error
        print(f"{arguments.output}: written")
    return 0


def schema(arguments: argparse.Namespace) -> int:
    """Print every key with its default, unit and description."""
    from contact_locking import study_file

    if terminal.is_root():
        text = json.dumps(study_file.schema(), indent=2) if arguments.json else None
        print(study_file.schema_text().rstrip() if text is None else text)
    return 0


_COMMANDS: dict[str, Callable[[argparse.Namespace], int]] = {
    command.__name__: command for command in (run, study, report, view, check, mesh, schema)
}


def _unexpected(error: Exception) -> tuple[str, str]:
    """In one line what went wrong, and in another what to do."""
    if isinstance(error, OSError) and error.strerror:
        place = error.filename or "a file of its own, perhaps in the cache of compiled forms"
        hint = (
            "The system refuses it, as with a full disk or a home that is read-only; "
            "XDG_CACHE_HOME says where compiled forms are kept."
        )
        return f"error: {error.strerror}: {place}", hint
    text = " ".join(f"error: unexpected {type(error).__name__}: {error}".split())
    return (
        text,
        "This is a defect; please report it with the study file and the output of --debug.",
    )


def _run_command(words: list[str], program: bool = False) -> int:
    """Run it; ``program`` says that the process is there for nothing else."""
    arguments = parse(words)
    arguments.program = program
    code = int(_COMMANDS[arguments.command](arguments))
    sys.stdout.flush()
    return code


def _overrides(arguments: argparse.Namespace) -> list[str]:
    """What the command line changes in the file."""
    if arguments.output is None:
        return list(arguments.set)
    # A JSON string is a YAML string.
    folder = json.dumps(arguments.output, ensure_ascii=False)
    return [*arguments.set, f"output.directory={folder}"]


def _keep_checkpoint(restart: Path, results: Path) -> None:
    """Refuse to replace the results that the run starts from by others without a checkpoint."""
    from contact_locking.checkpoint import locate

    if locate(restart).resolve() == locate(results).resolve():
        raise InputError(
            f"the results would replace the checkpoint in {results} that the run starts from: "
            "add --checkpoint to save the new state there, or give another folder by --output"
        )


def _load(path: Path, overrides: Sequence[str]) -> StudyFile:
    from contact_locking import study_file

    return study_file.load(path, overrides)


@contextlib.contextmanager
def _explained(study: StudyFile) -> Iterator[None]:
    """Add the place in the file to an InputError that knows its key."""
    try:
        yield
    except InputError as error:
        raise InputError(study.explain(error), error.key) from error


def _world_with_dolfinx(arguments: argparse.Namespace) -> MPI.Intracomm:
    """MPI's world, with PETSc initialised without the command line's words and petscrc files."""
    try:
        import petsc4py

        before = signal.getsignal(signal.SIGPIPE)
        # A folder that a study came in may hold options that run code; PETSC_OPTIONS is the user's.
        petsc4py.init(["contact-locking", "-skip_petscrc"])
        import dolfinx.fem.petsc  # noqa: F401
        from mpi4py import MPI
    except ImportError as error:
        raise ContactLockingError(
            f"DOLFINx cannot be imported here: {error}\n"
            "It needs DOLFINx 0.9 or newer with PETSc; the README says how to get it."
        ) from error
    from contact_locking import compiled_forms

    # PETSc takes a reader of the output who leaves early, as head does, for a crash.  A program of
    # one process ends there without a word, whether Python was printing or a monitor of PETSc.
    ends = arguments.program and MPI.COMM_WORLD.size == 1
    signal.signal(signal.SIGPIPE, signal.SIG_DFL if ends else before)
    if MPI.COMM_WORLD.rank == 0:
        compiled_forms.clear_unfinished()
    return MPI.COMM_WORLD


@contextlib.contextmanager
def _petsc_complaints() -> Iterator[None]:
    """What PETSc does not like about an option is bad input."""
    from petsc4py import PETSc

    try:
        yield
    except PETSc.Error as error:
        if error.ierr not in _OPTION_ERRORS:
            raise
        raise InputError(f"PETSc refuses an option: {str(error).splitlines()[-1]}") from error


def _largest_strain_ratio(solution: Solution) -> float:
    """The largest |eps|/M of the body; collective."""
    from mpi4py import MPI

    strain, limit = solution.strain_norm.x.array, solution.locking_limit.x.array
    largest = float((strain / limit).max(initial=0.0))
    return float(solution.domain.comm.allreduce(largest, op=MPI.MAX))


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)
