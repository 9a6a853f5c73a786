"""The progress of a study: live on a terminal, a line for each case in a log."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Self

from contact_locking.plain_text import duration, printable

from .cases import PROGRESS, Case, Outcome, State, read_mapping
from .executor import Slot

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

_STYLES: dict[State, str] = {"not converged": "yellow", "failed": "red"}


class View:
    """Shows the cases that run and that have ended; use it as a context manager.

    ``total`` is the number of cases to be solved.
    """

    def __init__(self, console: Console, total: int) -> None:
        from rich.live import Live

        self._console = console
        self._total = total
        self._states: Counter[State] = Counter()
        self._live: Live | None = None
        if console.is_terminal:
            # No thread refreshes the display, because this process forks others.
            self._live = Live(console=console, auto_refresh=False, transient=True)

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        if self._live is not None:
            self._live.stop()

    def line(self, text: str, style: str | None = None) -> None:
        """Print a line that stays on the terminal."""
        from rich.text import Text

        self._console.print(Text(printable(text)), style=style, soft_wrap=True)

    def ended(self, case: Case, outcome: Outcome, seconds: float) -> None:
        self._states[outcome.state] += 1
        width = len(str(self._total))
        reason = f": {outcome.reason}" if outcome.state != "converged" else outcome.reservation
        self.line(
            f"[{self._states.total():{width}}/{self._total}] {case.label}  "
            f"{outcome.state}{reason}  ({duration(seconds)})",
            _STYLES.get(outcome.state),
        )
        for warning in outcome.warnings:
            self.line(f"{'':{2 * width + 3}} warning: {warning}", "yellow")

    def show(self, running: Sequence[Slot]) -> None:
        """Refresh the display of the running cases."""
        if self._live is not None:
            self._live.update(self._picture(running), refresh=True)

    def _picture(self, running: Sequence[Slot]) -> Table:
        from rich.table import Table
        from rich.text import Text

        done = self._states.total()
        counts = [f"{done} of {self._total} done", f"{len(running)} running"]
        counts += [f"{self._states[state]} {state}" for state in _STYLES if self._states[state]]
        outer = Table.grid()
        outer.add_row(Text(", ".join(counts), style="bold"))
        inner = Table.grid(padding=(0, 2))
        for one in running:
            cells = (one.case.label, status(one.case), duration(one.seconds))
            inner.add_row(*(Text(f"  {printable(cell)}", no_wrap=True) for cell in cells))
        outer.add_row(inner)
        return outer


def status(case: Case) -> str:
    """The latest progress that a running case has recorded."""
    now = read_mapping(case.folder / PROGRESS)
    if now is None:
        return "starting"
    if "iteration" not in now:
        return str(now.get("message", ""))
    return f"n = {now.get('n')}  iteration {now['iteration']}  residual {now.get('residual')}"
