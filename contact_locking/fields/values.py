"""Values of numbers and expressions at points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from mpi4py import MPI

from contact_locking.arrays import AXES, FloatArray
from contact_locking.errors import with_key
from contact_locking.expressions import NO_TABLES, TIME, Table, parse
from contact_locking.parallel import agree


def evaluate(
    comm: MPI.Intracomm,
    value: float | str,
    x: FloatArray,
    key: str,
    infinite: bool = False,
    time: float = 0.0,
    tables: Mapping[str, Table] = NO_TABLES,
) -> FloatArray:
    """A number or an expression of x, y[, z] and t at points (d, k), as (k,); collective.

    Raises InputError with the key on all ranks if a value of any rank is NaN, or infinite without
    ``infinite``.
    """
    expression = parse(value, (*AXES, TIME), allow_infinite=infinite, tables=tables)
    places: dict[str, Any] = dict(zip(AXES, x, strict=False))
    places[TIME] = time
    result = agree(comm, lambda: with_key(key, lambda: expression.numpy(**places)))
    return np.broadcast_to(np.asarray(result, dtype=float), x.shape[1:]).copy()
