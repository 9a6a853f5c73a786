"""Errors that all ranks raise together, and values over all ranks.

An error that only one rank raises would leave the other ranks waiting.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import ContactLockingError, InputError

T = TypeVar("T")

# Values that differ by less, relative to the largest, are alike.
_ALIKE = 1e-6


def on_root(comm: MPI.Intracomm, work: Callable[[], T]) -> T:
    """Run ``work`` on rank 0; return the result, or raise the error, on all ranks; collective.

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

    This is for the data of the user, which each rank evaluates at its own points.
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


def maximum(comm: MPI.Intracomm, values: FloatArray | float, least: float = 0.0) -> float:
    """The largest of the values of all ranks and of ``least``; collective.

    A rank may have no values.
    """
    return float(comm.allreduce(float(np.max(values, initial=least)), op=MPI.MAX))


def peak(comm: MPI.Intracomm, values: FloatArray, places: FloatArray) -> tuple[float, Any]:
    """The largest of values (k,) >= 0 and its place (d,), None if all are zero; collective.

    If several values agree to rounding, the first place in lexicographic order counts; rounding
    does not change the order.
    """
    largest = maximum(comm, values)
    near = places[values >= (1.0 - _ALIKE) * largest] if largest > 0.0 else places[:0]
    order = np.round(near / (maximum(comm, np.abs(places)) or 1.0), 9)
    first = np.lexsort(order.T[::-1])[:1]
    candidates = comm.allgather([*zip(order[first].tolist(), near[first].tolist(), strict=True)])
    return largest, min(itertools.chain(*candidates), default=(None, None))[1]


def minimum(comm: MPI.Intracomm, values: FloatArray | float) -> float:
    """The smallest of the values of all ranks, infinite where no rank has any; collective."""
    return float(comm.allreduce(float(np.min(values, initial=math.inf)), op=MPI.MIN))


def exceeded_by_few(comm: MPI.Intracomm, values: FloatArray, few: int, least: float) -> float:
    """The smallest number, ``least`` or more, that no more than ``few`` values exceed; collective.

    Values that are no numbers count as small.  Every rank gathers ``few + 1`` values of each.
    """
    largest = np.sort(values[values > least])[-few - 1 :]
    gathered = np.sort(np.concatenate(comm.allgather(largest)))
    return float(gathered[-few - 1]) if len(gathered) > few else least


def on_any_rank(comm: MPI.Intracomm, marks: BoolArray | bool) -> bool:
    """Whether any mark of any rank is true; collective."""
    return bool(comm.allreduce(bool(np.any(marks)), op=MPI.LOR))


def on_every_rank(comm: MPI.Intracomm, marks: BoolArray | bool) -> bool:
    """Whether all marks of all ranks are true; collective."""
    return bool(comm.allreduce(bool(np.all(marks)), op=MPI.LAND))
