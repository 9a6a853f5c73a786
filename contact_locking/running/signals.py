"""Signals that ask a process to end, as an exception, so that the process cleans up first."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType

_ENDING = (signal.SIGTERM, signal.SIGHUP)


class Stopped(KeyboardInterrupt):
    """A signal other than that of Ctrl-C asked the process to end."""

    def __init__(self, number: int) -> None:
        self.signal = signal.Signals(number)
        super().__init__(f"stopped by {self.signal.name}")


@contextlib.contextmanager
def stoppable(at_once: Callable[[KeyboardInterrupt], None] | None = None) -> Iterator[None]:
    """Raise Stopped at SIGTERM, and at SIGHUP, which a terminal sends when it is closed.

    ``at_once`` is called before, also at Ctrl-C, and may end the process.  An ignored signal, such
    as SIGHUP under nohup, stays ignored.
    """
    handled = (*_ENDING, signal.SIGINT) if at_once is not None else _ENDING

    def stop(number: int, frame: FrameType | None) -> None:
        # A second signal must not interrupt the cleaning up; SIGKILL still ends the process.
        for ending in _ENDING:
            signal.signal(ending, signal.SIG_IGN)
        interrupt = KeyboardInterrupt() if number == signal.SIGINT else Stopped(number)
        if at_once is not None:
            at_once(interrupt)
        raise interrupt

    before = {number: signal.getsignal(number) for number in handled}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, stop)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def kept(*others: signal.Signals) -> Iterator[None]:
    """Restore the handlers of ``others``, SIGTERM and SIGHUP that a library may replace."""
    before = {number: signal.getsignal(number) for number in (*_ENDING, *others)}
    try:
        yield
    finally:
        for number, handler in before.items():
            # None stands for a handler that was not installed from Python.
            if handler is not None:
                signal.signal(number, handler)


def exit_code(interrupt: KeyboardInterrupt) -> int:
    """128 plus the number of the signal: the exit code that a shell gives for an ended process."""
    number = interrupt.signal if isinstance(interrupt, Stopped) else signal.SIGINT
    return 128 + int(number)
