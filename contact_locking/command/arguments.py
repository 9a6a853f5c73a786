"""The arguments of every command of ``contact-locking``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from contact_locking._version import __version__
from contact_locking.command.terminal import is_root
from contact_locking.errors import InputError

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

    one = add("new", "Write a study file to begin with: a demo with every key explained.")
    one.add_argument(
        "--like", metavar="DEMO", default="block", help="block, hertz, ball_3d or another demo"
    )
    one.add_argument(
        "-o", "--output", metavar="FILE", type=Path, default=Path("study.yml"),
        help="the new file, study.yml by default; no file is overwritten",
    )  # fmt: skip
    one = add_for_file("run", "Solve a study file; also under mpirun.", _PETSC_HINT)
    one.add_argument("--output", metavar="DIR", help="folder of the results")
    one.add_argument(
        "--checkpoint", action="store_true", help="save the state too, in the folder of the results"
    )
    one.add_argument(
        "--restart", metavar="DIR", type=Path, help="start from the state that a run saved there"
    )
    one.add_argument("--quiet", action="store_true", help="print warnings and errors only")
    one.add_argument("--progress", type=Path, help=argparse.SUPPRESS)  # for a study to look at
    one = add_for_file("study", "Solve every case of a study; repeat the command to continue it.")
    one.add_argument("--output", metavar="DIR", help="folder of the results")
    one.add_argument("--jobs", metavar="J", type=_positive, default=1, help="cases at a time")
    one.add_argument("--ranks", metavar="K", type=_positive, default=1, help="MPI ranks of each")
    one.add_argument(
        "--executor", choices=("local", "slurm"), default="local", help="where the cases run"
    )
    one = add("report", "Write an HTML page and charts of a finished run or study.")
    one.add_argument("directory", metavar="DIR", type=Path, help="folder of the results")
    one.add_argument("--pdf", action="store_true", help="also print the page, by Chromium")
    one = add("view", "Show the result of a run in a window, where there is a screen.")
    one.add_argument("directory", metavar="DIR", type=Path, help="folder of the results of a run")
    add_for_file("check", "Check a study file and list what would run, without a solve.")
    one = add_for_file("mesh", "Write the mesh of a study file as a Gmsh or XDMF file.")
    one.add_argument("-o", "--output", metavar="FILE", type=Path, required=True)
    one = add("schema", "Print every key with its default, unit and description.")
    one.add_argument("--json", action="store_true", help="as JSON schema, for editors")
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
