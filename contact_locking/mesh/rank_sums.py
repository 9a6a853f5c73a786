"""Sums and marks at cells, facets and nodes that several ranks share."""

from __future__ import annotations

import numpy as np
from dolfinx import common, la

from contact_locking.arrays import BoolArray, FloatArray, IndexArray


def summed(index_map: common.IndexMap, places: IndexArray, values: FloatArray) -> FloatArray:
    """(n, m) the sums over all ranks of values (..., m) at local places (...); collective."""
    size, rows = values.shape[-1], places.reshape(-1)
    total = la.vector(index_map, size)
    at = total.array.reshape(-1, size)
    for column, part in enumerate(values.reshape(-1, size).T):
        at[:, column] = np.bincount(rows, part, len(at))
    total.scatter_reverse(la.InsertMode.add)
    total.scatter_forward()
    return np.array(at)


def marked(index_map: common.IndexMap, places: IndexArray) -> BoolArray:
    """(n,) which local places, ghosts included, any rank has among ``places``; collective."""
    return summed(index_map, places, np.ones((*places.shape, 1)))[:, 0] > 0.0
