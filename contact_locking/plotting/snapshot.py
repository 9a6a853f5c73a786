"""Everything a picture shows as plain arrays; without DOLFINx."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from contact_locking.solution import ContactPoints

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class ContactMap:
    """Gamma_C: its points, and its facets (m, d) as indices of them.

    ``vertices`` (k,) are the points as vertices of the body, ``smoothed`` (k,) is R sigma_nu.
    """

    points: ContactPoints
    facets: IntArray
    vertices: IntArray
    smoothed: FloatArray


@dataclass(frozen=True)
class Snapshot:
    """The body with v vertices, c cells and b boundary facets, numbered over all ranks.

    ``x`` and ``displacement`` are (v, d), ``cells`` (c, d + 1), ``boundary`` (b, d) and
    ``boundary_cell`` (b,); strain norm, locking limit and ``locked`` are (c,).
    """

    x: FloatArray
    displacement: FloatArray
    cells: IntArray
    boundary: IntArray
    boundary_cell: IntArray
    strain_norm: FloatArray
    locking_limit: FloatArray
    locked: npt.NDArray[np.bool_]
    contact: ContactMap | None
    title: str
    dofs: int
    locked_fraction: float
    converged: bool

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])

    @property
    def size(self) -> float:
        """The longest edge of the body's bounding box."""
        return float(np.ptp(self.x, axis=0).max())
