"""The entry point of ``contact-locking``: every error becomes one message and an exit code.

Exit codes: 0 converged, 1 an unexpected error, 2 bad input, 3 not converged, 128 + N where signal
N ended the command, such as 130 after Ctrl-C.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import gc
import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from contact_locking._version import __version__
from contact_locking.command import commands, terminal
from contact_locking.command.terminal import is_root
from contact_locking.errors import ContactLockingError, InputError, interrupt_behind

_DESCRIPTION = "Frictional contact of locking materials: solves the problem of a study file."
_EXIT_CODES = (
    "exit codes: 0 converged, 1 unexpected error, 2 bad input, 3 not converged, "
    "128 + N ended by signal N"
)
_PETSC_HINT = "Options of PETSc come last, after --, such as: -- -ksp_type cg -pc_type gamg"
_ASSIGNMENT = re.compile(r"[\w.]+=")
_NEGATIVE_NUMBER = re.compile(r"-\.?\d")


def parse(words: Sequence[str]) -> argparse.Namespace:
    """The parsed arguments: ``command`` is its name, ``petsc`` the options after ``--``.

    Raises InputError for wrong arguments, and SystemExit after ``--help`` and ``--version``.
    """
    petsc: Sequence[str] = ()
    if "--" in words:
        split = list(words).index("--")
        words, petsc = words[:split], words[split + 1 :]
    arguments = parser().parse_args(one_setting_each(words))
    if petsc and arguments.command != "run":
        raise InputError("only run takes options of PETSc after --")
    arguments.petsc = petsc_options(petsc)
    return arguments


def parser() -> argparse.ArgumentParser:
    """All commands with their arguments."""
    whole = _Parser("contact-locking", description=_DESCRIPTION, epilog=_EXIT_CODES)
    whole.add_argument("--version", action="version", version=f"contact-locking {__version__}")
    commands = whole.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def add(name: str, about: str, epilog: str | None = None) -> _Parser:
        command = commands.add_parser(name, help=about, description=about, epilog=epilog)
        command.set_defaults(command=name)
        command.add_argument("--debug", action="store_true", help="show the traceback of an error")
        return command

    def add_for_file(*arguments: str) -> _Parser:
        command = add(*arguments)
        command.add_argument("file", metavar="FILE", type=Path, help="a study file")
        command.add_argument(
            "--set",
            metavar="KEY=VALUE",
            action="append",
            default=[],
            help="change a key of the file, such as penalty.n=1e6; several may follow",
        )
        return command

    def add_plan(command: _Parser, cases: str) -> None:
        command.add_argument(
            "--jobs", metavar="J", type=_positive, default=1, help=f"{cases} at a time"
        )
        command.add_argument(
            "--ranks", metavar="K", type=_positive, default=1, help="MPI ranks of each"
        )

    sub = add("new", "Copy the study file of a demo, to begin with.")
    sub.add_argument(
        "--like", metavar="DEMO", default="block", help="block, hertz, ball_3d or another demo"
    )
    sub.add_argument(
        "-o", "--output", metavar="FILE", type=Path, default=Path("study.yml"),
        help="the new file, study.yml by default; no file is overwritten",
    )  # fmt: skip
    sub = add_for_file("run", "Solve a study file; also under mpirun.", _PETSC_HINT)
    sub.add_argument("-o", "--output", metavar="DIR", help="folder of the results")
    sub.add_argument(
        "--checkpoint", action="store_true", help="save the state too, in the folder of the results"
    )
    sub.add_argument(
        "--restart", metavar="DIR", type=Path, help="start from the state that a run saved there"
    )
    sub.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    sub = add_for_file("study", "Solve every case of a study; repeat the command to continue it.")
    sub.add_argument("-o", "--output", metavar="DIR", help="folder of the results")
    add_plan(sub, "cases")
    sub = add_for_file("fit", "Fit numbers of a study file to curves; repeat it to continue.")
    sub.add_argument("-o", "--output", metavar="DIR", help="folder of the results")
    sub.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    sub = add_for_file("serve", "Answer requests of UM-Bridge for numbers of a study file.")
    sub.add_argument("--host", default="127.0.0.1", help="the address, 127.0.0.1 by default")
    sub.add_argument("--port", type=int, default=4242, help="the port, 4242 by default")
    sub = add("report", "Write an HTML page and charts of a finished run or study.")
    sub.add_argument("directory", metavar="DIR", type=Path, help="folder of the results")
    add_for_file("check", "Check a study file and list what would run, without a solve.")
    sub = add_for_file("mesh", "Write the mesh of a study file as a Gmsh file.")
    sub.add_argument("-o", "--output", metavar="FILE", type=Path, required=True)
    sub = add("schema", "Print every key with its default, unit and description.")
    sub.add_argument("--json", action="store_true", help="as JSON schema, for editors")
    return whole


def one_setting_each(words: Sequence[str]) -> list[str]:
    """``--set a=1 b=2`` as ``--set a=1 --set b=2``, so that FILE may follow the settings."""
    spread: list[str] = []
    inside = False
    for word in words:
        if inside and spread[-1] != "--set" and _ASSIGNMENT.match(word):
            spread.append("--set")
        else:
            inside = word == "--set" or (inside and spread[-1] == "--set")
        spread.append(word)
    return spread


def petsc_options(words: Sequence[str]) -> dict[str, str | None]:
    """``-ksp_type cg -ksp_view`` as ``{"ksp_type": "cg", "ksp_view": None}``."""
    options: dict[str, str | None] = {}
    name = ""
    for word in words:
        if word.startswith("-") and not _NEGATIVE_NUMBER.match(word):
            name = word.lstrip("-")
            options[name] = None
        elif name and options[name] is None:
            options[name] = word
        else:
            raise InputError(f"{word!r} after -- is no option of PETSc; they begin with a dash")
    return options


def _positive(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 0 < int(text) < 10**6):
        raise argparse.ArgumentTypeError(f"must be an integer from 1, not {text!r}")
    return int(text)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}\n{self.format_usage().rstrip()}")

    def _print_message(self, message: str, file: Any = None) -> None:
        # argparse would print help and version on every rank.
        if is_root():
            super()._print_message(message, file)


UNEXPECTED = 1


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; no exception leaves it.

    ``argv`` are the words after the program's name, those it was started with by default.
    """
    words = list(sys.argv[1:] if argv is None else argv)
    output = terminal.lasting_output() if argv is None else None
    arguments = argparse.Namespace()
    try:
        arguments = parse(words)
        code = _run_command(arguments, program=argv is None)
    except ContactLockingError as error:
        # All ranks have raised it.
        terminal.complain(f"error: {error}")
        code = error.exit_code
    except SystemExit as stop:  # argparse, after --help and --version
        code = int(stop.code or 0)
    except KeyboardInterrupt as interrupt:
        return _interrupted(interrupt, arguments)
    except BrokenPipeError:
        # Nobody reads the output any more; let the interpreter flush it to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNEXPECTED
    except Exception as error:
        behind = interrupt_behind(error)
        if isinstance(behind, KeyboardInterrupt):
            return _interrupted(behind, arguments)
        text, hint = _unexpected(error)
        if "--debug" in words:
            return terminal.abort(UNEXPECTED, text, error)
        return terminal.abort(UNEXPECTED, f"{text}\n{hint}")
    terminal.leave_together()
    if output is not None:
        # Python would look through all objects several times before the process ends.
        gc.freeze()
        code = UNEXPECTED if output.refused and code == 0 else code
    return code


def _run_command(arguments: argparse.Namespace, program: bool = False) -> int:
    """Run a command; ``program`` says that the process was started for it alone."""
    arguments.program = program
    end_ranks = functools.partial(_end_ranks, arguments)
    with terminal.stoppable(end_ranks) if program else contextlib.nullcontext():
        code = commands.COMMANDS[arguments.command](arguments)
    sys.stdout.flush()
    return code


def _interrupted(interrupt: KeyboardInterrupt, arguments: argparse.Namespace) -> int:
    said = str(interrupt) or "interrupted"
    if remains := getattr(arguments, "remains", lambda: "")():
        said += f"\n{remains}"
    return terminal.abort(terminal.exit_code(interrupt), said)


def _end_ranks(arguments: argparse.Namespace, interrupt: KeyboardInterrupt) -> None:
    """End all ranks if there are several.

    A rank that cleaned up, or went on, would meet the other ranks in the wrong place: they would
    wait for each other without end, or add up numbers that do not belong together.
    """
    if terminal.world() is not None:
        _interrupted(interrupt, arguments)


def _unexpected(error: Exception) -> tuple[str, str]:
    """One line about the error, and another about the remedy."""
    if isinstance(error, OSError) and error.strerror:
        place = error.filename or "an internal file, perhaps in the cache of compiled forms"
        hint = "The disk is full, or the folder of compiled forms is read-only (XDG_CACHE_HOME)."
        return f"error: {error.strerror}: {place}", hint
    text = " ".join(f"error: unexpected {type(error).__name__}: {error}".split())
    hint = "This is a defect; please report it with the study file and the output of --debug."
    return text, hint
