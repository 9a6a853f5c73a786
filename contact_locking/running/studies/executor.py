"""The command that solves a case, and the interface of the executors that run it."""

from __future__ import annotations

import os
import re
import shutil
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from contact_locking.errors import InputError
from contact_locking.results.names import PARAMETERS

from .cases import PROGRESS, Case

#: The program that solves a case; its arguments follow.  With -P, Python takes no modules from the
#: current folder, which may have come with the study.
PROGRAM = (sys.executable, "-P", "-m", "contact_locking")

_LOG_TAIL = 65_536
# An error as the command line prints it: its further lines are indented.
_ERROR = re.compile(r"^error: (.+(?:\n {7}.+)*)", re.MULTILINE)
# PETSc catches signals, prints this message and ends with an exit code of its own.
_CRASH = re.compile(r"PETSC ERROR: Caught signal number \d+ ([^,\n]+)")


def launcher(ranks: int) -> tuple[str, ...]:
    """The words before a program that start it on ``ranks`` ranks; none for one rank.

    Raises InputError if there is no mpirun.
    """
    if ranks == 1:
        return ()
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        raise InputError(
            f"--ranks {ranks} takes mpirun, which is not on the PATH; "
            "install MPI, or leave --ranks out"
        )
    return (mpirun, "-n", str(ranks))


def environment(jobs: int, ranks: int) -> dict[str, str]:
    """The environment variables of the cases; variables that the user has set stay."""
    defaults = {"PYTHONUNBUFFERED": "1"}
    if jobs * ranks > 1:
        defaults["OMP_NUM_THREADS"] = "1"
    if jobs > 1 and ranks > 1:
        # Each mpirun of Open MPI 4 and 5 would bind its ranks to the same first cores.
        defaults["OMPI_MCA_hwloc_base_binding_policy"] = "none"
        defaults["PRTE_MCA_hwloc_default_binding_policy"] = "none"
    return defaults | os.environ


def words(case: Case) -> list[str]:
    """The arguments that solve a case in its folder, once `outcome.begin` has prepared it."""
    progress = str(case.folder / PROGRESS)
    return [case.command, str(case.folder / PARAMETERS), "--progress", progress]


def command(case: Case, program: Sequence[str], ranks: int) -> list[str]:
    """The command that solves a case in a process of its own, or in one for each rank."""
    return [*launcher(ranks), *program, *words(case)]


def explain(code: int, log: Path) -> str:
    """The reason for an exit code in words, taken from the log of the process if it is there."""
    number = -code if code < 0 else code - 128
    if number in list(signal.Signals):
        name = signal.Signals(number).name
        hint = ", perhaps for want of memory" if number == signal.SIGKILL else ""
        return f"was killed by {name}{hint}"
    text = _tail(log)
    if code and (crash := _CRASH.search(text)):
        return f"crashed: {crash[1]}; see {log}"
    if code and (errors := _ERROR.findall(text)):
        return " ".join(errors[-1].split())
    if code in (0, 3):
        return "left no results of these parameters; has the mesh file changed meanwhile?"
    return f"ended with exit code {code}; see {log}"


def _tail(log: Path) -> str:
    try:
        with log.open("rb") as stream:
            stream.seek(max(0, log.stat().st_size - _LOG_TAIL))
            return stream.read().decode("utf-8", errors="replace")
    except OSError:
        return ""


@dataclass(frozen=True)
class Plan:
    """How many cases are solved at a time, on how many ranks each, where, and by which program."""

    jobs: int = 1
    ranks: int = 1
    executor: Literal["local", "slurm"] = "local"
    program: Sequence[str] = PROGRAM

    @property
    def shares_processes(self) -> bool:
        """Whether processes that stay solve the cases, each several of them."""
        return self.ranks == 1 and self.program == PROGRAM


class Running(Protocol):
    """A started case."""

    @property
    def case(self) -> Case: ...

    @property
    def seconds(self) -> float:
        """The time since the start of the case."""

    def why(self) -> str:
        """The reason why the case left no results, after its end."""
