"""The exceptions that the library raises.

The command line turns each into one message and an exit code.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar

T = TypeVar("T")

# The disk is full, the quota of the user is used up, or the file is too large (ulimit -f).
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
MAKE_ROOM = "Make room, and start it again."


class ContactLockingError(Exception):
    """Base of every error that this package raises on purpose.

    ``exit_code`` is the exit code of the command line for this error.
    """

    exit_code = 1


class InputError(ContactLockingError):
    """The study file, the mesh or an argument cannot be used as given.

    The message names the offending key or name, the value given and a value that would be right.
    ``key`` is the dotted key of the study file, or the argument of a script, if one is known.  A
    caller that holds the file can add the line; tracebacks show the key as a note.
    """

    exit_code = 2

    def __init__(self, message: str, key: str | None = None) -> None:
        super().__init__(message)
        self.key = key
        if key is not None:
            # A traceback of a script shows the note; the command line tells the key and its line.
            self.add_note(f"This is about {key}.")


class Misplaced(InputError):
    """A foundation is where no law of contact holds, as behind Gamma_C.

    A foundation that moves may have been in a place that is right before.
    """


class ProcessEnded(InputError):
    """Data cannot be used at a time, so that a process ends with the solution before.

    ``entries`` are those of the summary of this solution that say so.
    """

    def __init__(self, message: str, key: str | None, entries: Mapping[str, Any]) -> None:
        super().__init__(message, key)
        self.entries = entries


class NoDerivatives(InputError):
    """A problem can be solved, and its solution has no derivatives; the message says why."""


class NotConverged(ContactLockingError):
    """A solver stopped before its criteria held; ``code`` says which failure it is."""

    exit_code, code = 3, "solver.stalled"


class Infeasible(NotConverged):
    """No admissible field on this mesh has the prescribed values, by Farkas's lemma.

    The prescribed values times any number above ``factor`` exclude every field, too.  ``factor`` is
    infinite if smaller prescribed values are no remedy.
    """

    code = "solver.infeasible"

    def __init__(self, message: str, factor: float) -> None:
        super().__init__(message)
        self.factor = factor


class NotRefined(ContactLockingError):
    """A mesh cannot be refined further; the message says why."""


class NoRoom(ContactLockingError):
    """The disk is full; the same files can be written once there is room."""


class NoRendering(ContactLockingError):
    """Three dimensions cannot be drawn here; the message says why."""


def interrupt_behind(error: BaseException) -> BaseException | None:
    """The interruption of the process, such as Ctrl-C, behind ``error``; None if there is none.

    A library that calls back, such as PETSc, raises an error of its own where a callback is
    interrupted.
    """
    link: BaseException | None = error
    passed: set[int] = set()
    while link is not None and id(link) not in passed:
        if not isinstance(link, Exception):
            return link
        passed.add(id(link))
        link = link.__cause__ or link.__context__
    return None


def raise_callback_error(error: Exception) -> None:
    """Raise the exception of a callback again if the ``error`` of a library stands in its place.

    The caller judges failures of the numerical method itself, which are not raised here.
    """
    # `--help` reports errors, too, and NumPy would take most of its time.
    from numpy.linalg import LinAlgError

    if (interrupt := interrupt_behind(error)) is not None:
        raise interrupt from None
    cause = error.__cause__
    while cause is not None and type(cause) is type(error):
        cause = cause.__cause__
    is_numerical = isinstance(cause, NotConverged | ArithmeticError | LinAlgError)
    if cause is not None and not is_numerical:
        raise cause from None


def is_full(error: OSError) -> bool:
    """Whether the system has no room, on the disk, for the user or in one file."""
    return error.errno in _FULL


def reports_full_disk(text: str) -> bool:
    """Whether an error that another process has printed is one of `is_full`."""
    return any(os.strerror(number) in text for number in _FULL)


def not_written(
    what: str, error: OSError, place: str | Path, key: str | None = None, advice: str = ""
) -> ContactLockingError:
    """The error with the message ``what``, the reason of the system, and the file or ``place``.

    A full disk gives NoRoom and not InputError, because the input is right; ``advice`` is then what
    to do, in place of making room.
    """
    message = f"{what}: {error.strerror or error} ({error.filename or place})"
    if is_full(error):
        return NoRoom(f"{message}\n{advice or MAKE_ROOM}")
    return InputError(f"{message}; give a folder that can be written to", key)


@contextlib.contextmanager
def explained(
    what: str, place: str | Path, key: str | None = None, advice: str = ""
) -> Iterator[None]:
    """Raise the error of `not_written` in place of an OSError of the block."""
    try:
        yield
    except BrokenPipeError:
        raise  # The reader of the output has gone; no file is concerned.
    except OSError as error:
        raise not_written(what, error, place, key, advice) from error


def require_kind(value: object, kind: type[Any] | UnionType, description: str, key: str) -> None:
    """Raise InputError unless ``value`` is of a kind, whose ``description`` is in words."""
    if not isinstance(value, kind):
        raise InputError(f"must be {description}, not {type(value).__name__}", key)


def with_key(key: str, work: Callable[[], T]) -> T:
    """Run ``work``, and give ``key`` to an InputError that has no key."""
    try:
        return work()
    except InputError as error:
        if error.key is not None:
            raise
        raise InputError(str(error), key) from error
