"""Work on one rank or on all of them whose error every rank raises.

An error on one rank alone would leave the other ranks waiting.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from mpi4py import MPI

from contact_locking.errors import ContactLockingError, InputError

T = TypeVar("T")


def on_root(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Run ``work`` on rank 0, and return its result or raise its error on all ranks; collective.

    A ValueError, RuntimeError or OSError of ``work`` is raised as an InputError.
    """
    outcome: tuple[T | None, Exception | None] = (None, None)
    if comm.rank == 0:
        try:
            outcome = (work(), None)
        except ContactLockingError as error:
            outcome = (None, error)
        except (ValueError, RuntimeError) as error:
            outcome = (None, InputError(str(error)))
        except OSError as error:
            outcome = (None, InputError(f"{error.filename}: {error.strerror or error}"))
    result, failure = comm.bcast(outcome, root=0)
    if failure is not None:
        raise failure
    return result


def agree(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Run ``work`` on every rank, and raise the first error of any rank on all; collective.

    Use it where user data is evaluated at the points of each rank.
    """
    failure: ContactLockingError | None = None
    try:
        result = work()
    except ContactLockingError as error:
        failure = error
    for raised in comm.allgather(failure):
        if raised is not None:
            raise raised
    return result
