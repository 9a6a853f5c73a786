"""How a running solve tells its progress; the base class says nothing."""

from __future__ import annotations


class Monitor:
    """Hears of the progress of a solve and does nothing; derived classes show it.

    Every rank calls its monitor with the same values: give a monitor that prints to rank 0 only.
    """

    def message(self, text: str) -> None:
        """A text that deserves a line of its own."""

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        """The solve with penalties n and epsilon begins, number ``index`` from 1."""

    def friction_update(self, k: int, change: float, factor: float | None) -> None:
        """Update k changed the friction bound by the relative amount ``change``.

        ``factor`` is the contraction observed so far; None before it can be observed.
        """

    def iteration(self, k: int, residual: float) -> None:
        """``residual`` is the relative residual after k iterations, from 0."""

    def finish(self) -> None:
        """The last stage is over."""
