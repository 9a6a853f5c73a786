"""Values over the steps of a process: columns of its history, and expressions of them."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.expressions import parse
from contact_locking.results.history import History


def values_of(text: str, history: History) -> FloatArray:
    """The values (k,) of a column, or of an expression of columns.  Raises InputError."""
    if text in history.columns:
        return history.column(text)
    names = [name for name in history.columns if name.isidentifier()]
    expression = parse(text, names)
    values = expression.numpy(**{name: history.column(name) for name in names})
    return np.broadcast_to(np.asarray(values, dtype=float), len(history))
