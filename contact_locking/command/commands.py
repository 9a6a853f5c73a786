"""The commands: each takes the parsed arguments and returns the exit code.

A command imports the modules that it needs when it runs: help and schema appear at once, and a
wrong file is reported without DOLFINx.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contact_locking import wings
from contact_locking.command import terminal
from contact_locking.command.terminal import petsc_complaints, world_with_dolfinx
from contact_locking.errors import ContactLockingError, InputError, explained
from contact_locking.plain_text import count, gigabytes, nearest, printable

if TYPE_CHECKING:
    from mpi4py import MPI

    from contact_locking.solver.monitor import Monitor
    from contact_locking.study_file import StudyFile
    from contact_locking.study_file.parameters import Parameters

CONVERGED, NOT_CONVERGED = 0, 3
# Gmsh takes some seconds for more cells.
_MANY_CELLS = 50_000


def new(arguments: argparse.Namespace) -> int:
    """Copy the study file of a demo, and the data that it reads, where no files are yet."""
    from contact_locking import files, study_file

    place, like = arguments.output, arguments.like
    folder = Path(study_file.__file__).parent / "demos"
    names = sorted(path.stem for path in folder.glob("*.yml"))
    if like not in names:
        known = f"{nearest(like, names)}; there are {', '.join(names)}"
        raise InputError(f"--like: no demo is named {like[:60]!r}{known}")
    text = (folder / f"{like}.yml").read_text(encoding="utf-8")
    data = [path for path in folder.iterdir() if path.suffix != ".yml" and path.name in text]
    # Without a folder in the file, the results go to that of its own name.
    text = text.replace(f"output: {{directory: results/{like}}}\n", "").rstrip() + "\n"
    text = text.replace(f"demos/{like}.yml", printable(str(place), keep=""))
    contents = {place: text.encode()}
    contents |= {place.parent / path.name: path.read_bytes() for path in data}
    if terminal.is_root():
        for path, content in contents.items():
            with explained(f"cannot write {path}", path):
                try:
                    files.write_new(path, content)
                except FileExistsError:
                    message = f"{path}: the file exists; give another name with -o FILE"
                    raise InputError(message) from None
        rows = (("check", "what is wrong, or what would run"), ("run", "solves, and draws"))
        steps = [(f"  contact-locking {name} {place}", about) for name, about in rows]
        print(f"{place}: written, a copy of the demo {like}. Change it, and then:")
        print(terminal.columns(steps))
    return 0


def run(arguments: argparse.Namespace) -> int:
    """Solve, write the results, and print the summary."""
    study = _load(arguments, arguments.output)
    comm = world_with_dolfinx(arguments)
    from contact_locking.results import in_words
    from contact_locking.running.run import run as solve_and_write

    parameters, directory = study.parameters, study.parameters.output.directory
    #: The remains of an interrupted run, in words.
    arguments.remains = lambda: _remains_of_run(arguments, parameters)
    options = (arguments.petsc, arguments.restart, arguments.checkpoint)
    with _solving(arguments, study, comm) as (monitor, speaks):
        if speaks and parameters.study is not None:
            print("The file describes a study; run solves its base case.")
        solution, warnings = solve_and_write(parameters, directory, comm, monitor, *options)
    summary = solution.summary
    for warning in [*(solution.warnings if arguments.quiet else ()), *warnings]:
        terminal.complain(f"warning: {warning}")
    if speaks:
        tables = [[*in_words.rows(summary), ("results in", directory)]]
        tables += [table(summary) for table in wings.TABLES]
        print("\n".join(map(terminal.columns, filter(None, tables))))
    if solution.converged:
        return CONVERGED
    reasons = (f"not converged: {solution.reason}", solution.suggestion)
    lines = (*filter(None, reasons), f"The state that it reached is in {directory}.")
    terminal.complain("error: " + "\n".join(lines))
    return NOT_CONVERGED


def study(arguments: argparse.Namespace) -> int:
    """Solve every case of a study that is not finished, and write the table of all."""
    if terminal.world() is not None:
        raise InputError("start a study without mpirun: --ranks K runs each case on K ranks")
    began = time.perf_counter()
    file = _load(arguments, arguments.output)
    from contact_locking.running.runner import Plan, Study, finish

    plan = Plan(arguments.jobs, arguments.ranks)
    with _explained(file):
        done = Study.of(file)
        finish(done, file.parameters, plan, terminal.say)
    print(terminal.columns(done.rows(time.perf_counter() - began)))
    return CONVERGED if set(done.count()) == {"converged"} else NOT_CONVERGED


def fit(arguments: argparse.Namespace) -> int:
    """Fit numbers of the file to its measured curves, and print what was found."""
    file = _load(arguments, arguments.output)
    comm = world_with_dolfinx(arguments)
    from contact_locking.inverse import fitting

    directory = file.parameters.output.directory
    arguments.remains = lambda: (
        f"the evaluations so far are in {directory}; the same command goes on from there"
    )
    with _solving(arguments, file, comm) as (monitor, speaks):
        estimate, solution = fitting.fit(file.parameters, directory, comm, monitor)
    for text in [*estimate["words"], *estimate["undetermined"]]:
        terminal.complain(f"warning: {text}")
    if speaks:
        print(terminal.columns(fitting.rows(estimate)))
        print(f"results in {directory}")
    if estimate["converged"] and solution.converged:
        return CONVERGED
    terminal.complain(f"error: not converged: {estimate['reason']}")
    return NOT_CONVERGED


def serve(arguments: argparse.Namespace) -> int:
    """Answer requests for quantities of a study at numbers that they bring, until Ctrl-C."""
    if terminal.world() is not None:
        raise InputError("start a server without mpirun; several have a --port each")
    file = _load(arguments)
    comm = world_with_dolfinx(arguments)
    from contact_locking.inverse import um_bridge

    with _explained(file):
        um_bridge.serve(file.parameters, comm, arguments.host, arguments.port)
    return CONVERGED


def report(arguments: argparse.Namespace) -> int:
    """Write the page and the charts of a finished run or study."""
    from contact_locking.view.report import write

    if terminal.is_root():
        try:
            for page in write(arguments.directory):
                print(f"{page}: written")
        except ImportError as error:
            raise ContactLockingError(f"a report takes Matplotlib and Jinja2: {error}") from error
    return 0


def check(arguments: argparse.Namespace) -> int:
    """Print the errors of a study file, or what would run; solve nothing."""
    study = _load(arguments)
    parameters = study.parameters
    comm = world_with_dolfinx(arguments)
    # The modules of the solvers and of the results take a third of the time of this command.
    from contact_locking.mesh.parts import group_table
    from contact_locking.results import output as output_folder
    from contact_locking.running import assembly
    from contact_locking.solver.ksp import estimated_memory

    with _explained(study):
        output_folder.prepare(parameters.output.directory, comm)
        experiments = []
        if parameters.fit is not None:
            from contact_locking.inverse.model import read_experiments, variables_of

            experiments = read_experiments(parameters)
            variables_of(parameters)
        cells = getattr(parameters.mesh.geometry, "estimated_cells", lambda: 0.0)()
        if comm.rank == 0 and cells > _MANY_CELLS:
            print(f"meshing, about {cells:.0e} cells", flush=True)
        facts = assembly.check(parameters, comm)
    for finding in facts.pop("findings"):
        terminal.complain(f"warning: {finding}")
    if comm.rank == 0:
        rows = [("mesh", parameters.mesh.file or str(parameters.mesh.builder))]
        table, held, size = (facts.pop(name) for name in ("groups", "held by", "compact dofs"))
        del facts["regions"], facts["boundary parts"]  # the table has them
        rows += [(name, _shown(value)) for name, value in facts.items()]
        rows += [(f"{body_part} is held by", words) for body_part, words in held.items()]
        if parameters.study is not None:
            from contact_locking.running.runner import Study

            cases = Study.of(study)
            finished = f"{cases.finished} finished in {cases.directory}"
            rows.append(("cases of the study", f"{len(cases.cases)}, {finished}"))
        if parameters.fit is not None:
            numbers = sum(experiment.count for experiment in experiments)
            fitted = f"{len(parameters.fit.parameters)} to {numbers} measured numbers"
            rows.append(("numbers to fit", fitted))
        unknowns = facts["dofs"]
        if parameters.adapt is not None:
            unknowns = size = max(unknowns, parameters.adapt.max_dofs)
        linear, dim = parameters.solver.linear, facts["dimension"]
        memory = gigabytes(estimated_memory(linear, dim, unknowns, size, comm.size))
        about = "about" if parameters.adapt is None else "at most about"
        rows.append(("estimated memory", f"{about} {memory} on {count(comm.size, 'rank')}"))
        print(f"{arguments.file} can be run:\n{terminal.columns(rows)}\n")
        print(terminal.columns(group_table(table)))
    return 0


def mesh(arguments: argparse.Namespace) -> int:
    """Write the mesh of a study file's builder as a Gmsh file."""
    if arguments.file.suffix.lower() == ".inp":
        raise InputError(f"a study file can use the deck directly: mesh.file: {arguments.file}")
    study, place = _load(arguments), arguments.output
    geometry = study.parameters.mesh.geometry
    with _explained(study):
        if geometry is None:
            raise InputError("the mesh is a file already, nothing is built", "mesh.file")
    if not terminal.is_root():
        return 0
    from contact_locking.meshes import write

    if place.exists() or place.is_symlink():
        raise InputError(f"{place}: the file exists; give another name with -o FILE")
    try:
        with explained(f"cannot write {place}", place):
            write(geometry, place, study.parameters.refined_names)
    except ImportError as error:
        raise ContactLockingError(f"Gmsh cannot be imported: {error}") from error
    except (ValueError, RuntimeError) as error:
        raise InputError(str(error)) from error
    print(f"{place}: written")
    return 0


def schema(arguments: argparse.Namespace) -> int:
    """Print every key with its default, unit and description."""
    from contact_locking import study_file

    if terminal.is_root():
        if arguments.json:
            print(json.dumps(study_file.schema(), indent=2, ensure_ascii=False))
        else:
            print(study_file.schema_text().rstrip())
    return 0


COMMANDS = {f.__name__: f for f in (new, run, study, fit, serve, report, check, mesh, schema)}


def _remains_of_run(arguments: argparse.Namespace, parameters: Parameters) -> str:
    """Which steps of an interrupted run are saved, and how to go on; not collective."""
    from contact_locking import study_file
    from contact_locking.process.checkpoint import SavedSteps

    directory = Path(parameters.output.directory)
    if parameters.steps is not None and arguments.restart is None:
        number = SavedSteps(directory).last_of(study_file.fingerprint(parameters))
        if number > 0:
            return f"{number} steps are saved in {directory}; the same command goes on from there"
    return "nothing is saved: a run saves its state at its end" if arguments.checkpoint else ""


@contextlib.contextmanager
def _solving(
    arguments: argparse.Namespace, study: StudyFile, comm: MPI.Intracomm
) -> Iterator[tuple[Monitor, bool]]:
    """The monitor of a solve that has the folder of the results for itself.

    It is the terminal, if the command speaks.
    """
    from contact_locking.command.terminal import TerminalMonitor
    from contact_locking.results import output as output_folder
    from contact_locking.solver.monitor import Monitor

    speaks = comm.rank == 0 and not arguments.quiet
    monitor = TerminalMonitor() if speaks else Monitor()
    reserved = output_folder.reserved(study.parameters.output.directory, comm)
    with _explained(study), reserved, petsc_complaints():
        yield monitor, speaks
        monitor.finish()


def _load(arguments: argparse.Namespace, directory: str | None = None) -> StudyFile:
    """The study file with the changes of ``--set``, and with the folder of its results."""
    from contact_locking import study_file

    # Every JSON string is a YAML string.
    quoted = json.dumps(directory, ensure_ascii=False)
    changes = [] if directory is None else [f"output.directory={quoted}"]
    return study_file.load(arguments.file, [*arguments.set, *changes])


@contextlib.contextmanager
def _explained(study: StudyFile) -> Iterator[None]:
    """Add the line in the study file to an InputError that has a key."""
    try:
        yield
    except InputError as error:
        raise InputError(study.explain(error), error.key) from error


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ", ".join(map(str, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)
