"""The interface of the executors: processes on this machine, or a batch system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from .case_command import PROGRAM
from .cases import Case


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


class Executor(Protocol):
    """Runs cases: call ``poll`` as long as the executor is ``busy``, then ``stop``."""

    #: Seconds between two calls of ``poll``.
    pause: float

    @property
    def busy(self) -> bool:
        """Whether cases wait or run."""

    @property
    def running(self) -> Sequence[Running]: ...

    def poll(self) -> Sequence[Running]:
        """Start the next cases, and return the cases that have ended since the last call.

        Raises OSError where a case cannot be started.
        """

    def stop(self) -> None:
        """End the running cases."""
