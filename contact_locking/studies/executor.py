"""What runs the cases: processes here, or a batch system."""

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


class Running(Protocol):
    """A case that has been started."""

    @property
    def case(self) -> Case: ...

    @property
    def seconds(self) -> float:
        """How long it has been running."""

    def why(self) -> str:
        """Why it left no results, after it has ended."""


class Executor(Protocol):
    """Runs cases until none is left; used as long as ``busy``, and then stopped."""

    #: Time that may pass between two calls of ``poll``.
    pause: float

    @property
    def busy(self) -> bool:
        """Whether cases are waiting or running."""

    @property
    def running(self) -> Sequence[Running]: ...

    def poll(self) -> Sequence[Running]:
        """Start what can be started, and return the cases that have ended since the last call.

        Raises OSError where a case cannot be started.
        """

    def stop(self) -> None:
        """End what is running."""
