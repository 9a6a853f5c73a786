"""Monitors of a solve: lines on a terminal or in a log, and a file for another process."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from contact_locking.files.atomic import write_text
from contact_locking.monitor import Attentive, Monitor
from contact_locking.plain_text import count, printable

# After so many seconds without a line in a log, the next iteration prints one.  It leaves room for
# an iteration in the ten seconds that a log of a long run is silent at most.
_SILENCE = 5.0


class TerminalMonitor(Monitor):
    """A live line on a terminal; in a log, a line for each stage and friction update.

    Stages that take longer have further lines in a log, which show that the solve goes on.

    Use it as a context manager; ``console`` is a ``rich.console.Console``.
    """

    def __init__(self, console: Any) -> None:
        self._console = console
        self._live = console.status("") if console.is_terminal else None
        self._step = self._stage = ""
        self._iterations = 0
        # Tangents and friction updates of the solve, and those of the stages before this one.
        self._counts = self._before = (0, 0)
        self._detail = ""
        # None before the first iteration of a stage.
        self._residual: float | None = None
        self._krylov = 0
        self._began = self._printed = time.perf_counter()

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.finish()
        if self._live is not None:
            self._live.stop()

    def message(self, text: str) -> None:
        if text.startswith("warning"):
            self._warn(text)
            return
        self.finish()
        if self._live is not None:
            self._live.update(self._plain(text))
        else:
            self._line(text)

    def step(self, number: int, left: int, time: float) -> None:
        self.finish()
        self._step = f"step {number}  t = {time:.6g}  ({left} to do)  "
        # The solve of each step counts from zero.
        self._counts = self._before = (0, 0)

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        self.finish()
        of = f"/{count_estimate}" if index <= count_estimate else ""
        self._stage = f"{self._step}stage {index}{of}  n = {n:.3g}  epsilon = {epsilon:.3g}"
        self._iterations, self._detail, self._krylov, self._residual = 0, "", 0, None
        self._began = time.perf_counter()
        self._refresh()

    def friction_update(self, k: int, change: float, factor: float | None) -> None:
        rate = "" if factor is None else f", contraction {factor:.2f}"
        self._detail = f"friction update {k}: change {change:.1e}{rate}"
        if self._live is None:
            self._line(f"  {self._detail}")
        self._refresh()

    def iteration(self, k: int, residual: float) -> None:
        # Iteration 0 begins a further solve within the stage.
        self._iterations += k > 0
        self._residual = residual
        self._refresh()
        self._show_life()

    def linear(self, k: int) -> None:
        # Iteration 0 begins a further linear solve.
        self._krylov += k > 0
        self._show_life()

    def mesh(self, number: int, text: str) -> None:
        self.finish()
        self._line(f"mesh {number}: {text}")
        # The solve on the next mesh counts from zero.
        self._counts = self._before = (0, 0)

    def counted(self, tangents: int, friction_updates: int) -> None:
        self._counts = (tangents, friction_updates)

    def finish(self) -> None:
        if not self._stage:
            return
        tangents, updates = (
            now - then for now, then in zip(self._counts, self._before, strict=True)
        )
        counts = count(tangents, "tangent")
        if updates:
            counts += f", {count(updates, 'friction update')}"
        seconds = time.perf_counter() - self._began
        self._line(f"{self._stage}  {counts}{self._residual_in_words()}, {seconds:.1f} s")
        self._stage, self._before = "", self._counts

    def _refresh(self) -> None:
        if self._live is not None and self._stage:
            now = f"iteration {self._iterations}{self._residual_in_words()}"
            self._live.update(
                self._plain("  ".join(filter(None, (self._stage, self._detail, now))))
            )

    def _show_life(self) -> None:
        """Print how far the stage is, where a log has been silent for long."""
        now = time.perf_counter()
        if self._live is not None or now - self._printed < _SILENCE or not self._stage:
            return
        krylov = f", {count(self._krylov, 'Krylov iteration')}" if self._krylov else ""
        done = f"iteration {self._iterations}{self._residual_in_words()}{krylov}"
        self._line(f"  {self._stage}  {done}, {now - self._began:.0f} s")

    def _residual_in_words(self) -> str:
        return "" if self._residual is None else f", residual {self._residual:.1e}"

    def _line(self, text: str) -> None:
        self._printed = time.perf_counter()
        self._console.print(self._plain(text), soft_wrap=True)

    def _warn(self, text: str) -> None:
        """Print to standard error, also if the output goes to a file."""
        # While the line is live, rich redirects standard error.
        if self._live is not None:
            self._live.stop()
        print(text, file=sys.stderr, flush=True)
        if self._live is not None:
            self._live.start()

    @staticmethod
    def _plain(text: str) -> Any:
        # A Text takes brackets as they are, not as markup of rich; a live line has to be one line.
        from rich.text import Text

        return Text(printable(text), no_wrap=True, overflow="ellipsis")


class ProgressFile(Attentive):
    """Keeps the latest progress in a small JSON file, and passes all calls on to ``listener``.

    The file holds ``{"message": ...}`` before the first stage, then ``{"n": ..., "iteration": ...,
    "residual": ...}`` with numbers as text.  A file that cannot be written does not stop the solve.
    """

    def __init__(self, path: Path, listener: Monitor) -> None:
        super().__init__(listener)
        self._path = path
        self._n = ""

    def message(self, text: str) -> None:
        super().message(text)
        self._write(message=text)

    def step(self, number: int, left: int, time: float) -> None:
        super().step(number, left, time)
        self._write(message=f"step {number}, {left} to do")

    def stage(self, index: int, count_estimate: int, n: float, epsilon: float) -> None:
        super().stage(index, count_estimate, n, epsilon)
        self._n = f"{n:.3g}"
        self._write(message=f"n = {self._n}")

    def iteration(self, k: int, residual: float) -> None:
        super().iteration(k, residual)
        self._write(n=self._n, iteration=str(k), residual=f"{residual:.1e}")

    def mesh(self, number: int, text: str) -> None:
        super().mesh(number, text)
        self._write(message=f"mesh {number}: {text}")

    def _write(self, **news: str) -> None:
        with contextlib.suppress(OSError):
            write_text(self._path, json.dumps(news))
