"""The matrix of a square grid, two unknowns at each node, and a right-hand side."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

SIDE = 40


def grid(contrast: float = 1.0, side: int = SIDE) -> sp.csr_matrix:
    """Two unknowns at each node of a square grid, coupled; stiffer to the right by a factor."""
    line = sp.diags([-1.0, 2.0, -1.0], [-1, 0, 1], shape=(side, side))
    stiffness = sp.diags(np.linspace(1.0, contrast, side) ** 0.5)
    nodes = sp.kronsum(stiffness @ line @ stiffness, line)
    return sp.csr_matrix(sp.kron(nodes, [[2.0, 1.0], [1.0, 3.0]]))


RIGHT = np.random.default_rng(3).standard_normal(2 * SIDE**2)
