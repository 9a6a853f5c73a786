"""Signals that ask a process to end, as an exception that lets it clean up behind itself."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType

_ENDING = (signal.SIGTERM, signal.SIGHUP)


class Stopped(KeyboardInterrupt):
    """A signal other than that of Ctrl-C has asked the process to end."""

    def __init__(self, number: int) -> None:
        self.signal = signal.Signals(number)
        super().__init__(f"stopped by {self.signal.name}")


@contextlib.contextmanager
def stoppable() -> Iterator[None]:
    """Raise Stopped at SIGTERM and at SIGHUP, which closing a terminal sends.

    A signal that is ignored, as SIGHUP under nohup, stays ignored.
    """

    def stop(number: int, frame: FrameType | None) -> None:
        # Another one must not end the cleaning up; SIGKILL still does.
        for ending in _ENDING:
            signal.signal(ending, signal.SIG_IGN)
        raise Stopped(number)

    before = {number: signal.getsignal(number) for number in _ENDING}
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
    """Keep what these signals and those that ask to end do, whatever a library makes of them."""
    before = {number: signal.getsignal(number) for number in (*_ENDING, *others)}
    try:
        yield
    finally:
        for number, handler in before.items():
            # None stands for what was installed outside of Python.
            if handler is not None:
                signal.signal(number, handler)


def exit_code(interrupt: KeyboardInterrupt) -> int:
    """128 and the number of the signal, as a shell gives for a process that a signal has ended."""
    number = interrupt.signal if isinstance(interrupt, Stopped) else signal.SIGINT
    return 128 + int(number)
