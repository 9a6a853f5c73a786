"""The interface through which a solve reports its progress."""

from __future__ import annotations


class Monitor:
    """Receives the progress of a solve and shows nothing; derived classes show the progress.

    Every rank calls its monitor with the same values.  A monitor that prints belongs to rank 0
    only.
    """

    def message(self, text: str) -> None:
        """Show a text on a line of its own."""

    def step(self, number: int, remaining: int, time: float) -> None:
        """Step ``number``, from 1, to a time begins; ``remaining`` planned ones include it."""

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        """Stage ``index``, counted from 1, begins: the solve with the penalties n and epsilon."""

    def friction_update(self, k: int, change: float, factor: float | None) -> None:
        """Update k of the solve changed the friction bound by the relative amount ``change``.

        ``factor`` is the contraction observed so far, None while none can be observed.
        """

    def iteration(self, k: int, residual: float) -> None:
        """``residual`` is the relative residual after k iterations, from 0."""

    def linear(self, k: int) -> None:
        """The present linear solve has done k Krylov iterations, from 0."""

    def mesh(self, number: int, text: str) -> None:
        """The solve on adapted mesh ``number``, from 1, is over, with the result ``text``."""

    def counted(self, tangents: int, friction_updates: int) -> None:
        """So many tangents and updates of the friction bound the solve has taken so far."""

    def finish(self) -> None:
        """The last stage is over."""
