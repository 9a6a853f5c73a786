"""The exceptions that the library raises.

The command line turns each into one message and an exit code.
"""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

# No room on the disk, no more for this user, and no more in one file (ulimit -f).
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
MAKE_ROOM = "Make room, and start it again."


class ContactLockingError(Exception):
    """Base of every error that this package raises on purpose.

    ``exit_code`` is what the command line returns for it.
    """

    exit_code = 1


class InputError(ContactLockingError):
    """The study file, the mesh or an argument cannot be used as given.

    The message names the offending key or name, what was given and what would be right.
    ``key`` is the dotted key of the study file where it is known, so that a caller that holds
    the file can add the line.
    """

    exit_code = 2

    def __init__(self, message: str, key: str | None = None) -> None:
        super().__init__(message)
        self.key = key


class NotConverged(ContactLockingError):
    """A solver stopped before its criteria held; the message says which one and the way out."""

    exit_code = 3


class Infeasible(NotConverged):
    """No admissible field on this mesh has the prescribed values, by Farkas's lemma.

    The prescribed values times any number above ``factor`` exclude all of them, too; it is infinite
    if scaling them is not the way out.
    """

    def __init__(self, message: str, factor: float) -> None:
        super().__init__(message)
        self.factor = factor


class NoRoom(ContactLockingError):
    """The disk is full; once there is room, the same will be written."""


class NoRendering(ContactLockingError):
    """Three dimensions cannot be drawn here; the message says why."""


def is_full(error: OSError) -> bool:
    """Whether the system has no room, on the disk, for the user or in one file."""
    return error.errno in _FULL


def not_written(
    what: str, error: OSError, place: str | Path, key: str | None = None, more: str = ""
) -> ContactLockingError:
    """The error for ``what`` could not be done at ``place``, as the system said.

    A disk without room is no bad input: what was asked for is right, once there is room; ``more``
    says what else to do then.
    """
    message = f"{what}: {error.strerror or error} ({error.filename or place})"
    if is_full(error):
        return NoRoom(f"{message}\n{more or MAKE_ROOM}")
    return InputError(f"{message}; give a folder that can be written to", key)


@contextlib.contextmanager
def explained(
    what: str, place: str | Path, key: str | None = None, more: str = ""
) -> Iterator[None]:
    """Turn an OSError of the block into the error of `not_written`."""
    try:
        yield
    except BrokenPipeError:
        raise  # The reader of the output has gone; no file is concerned.
    except OSError as error:
        raise not_written(what, error, place, key, more) from error


def with_key(key: str, work: Callable[[], T]) -> T:
    """Run ``work``; an InputError that comes out of it without a key is given this one."""
    try:
        return work()
    except InputError as error:
        if error.key is not None:
            raise
        raise InputError(str(error), key) from error
