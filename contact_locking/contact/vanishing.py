"""A smoothing R that vanishes where displacement conditions meet Gamma_C."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.smoothing import Smoothing
from contact_locking.contact.surface_mesh import SurfaceMesh


class VanishingOperator:
    """``f R (f w)`` with ``f = min(1, d/r)`` and the distance d to the held nodes of Gamma_C.

    Beside a clamp the normal stress is in the dual of ``H^1/2_00(Gamma_C)`` alone, and the kernel
    of ``f R f`` is in that space, as it vanishes there in both of its points.  ``surface`` is
    Gamma_C with the weight 0 at held nodes, and the distance is measured along it.  ``radius`` is
    r.  ``smoothing`` is R, which this object destroys.
    """

    keeps_constants = False

    def __init__(self, smoothing: Smoothing, surface: SurfaceMesh, radius: float) -> None:
        self._smoothing = smoothing
        self._factor: FloatArray = np.ones(len(surface.weights[surface.own]))
        for row, column, distance in surface.within(radius):
            held = surface.weights[column] == 0.0
            np.minimum.at(self._factor, row[held], distance[held] / radius)

    def apply(self, values: FloatArray) -> FloatArray:
        return self._factor * self._smoothing.apply(self._factor * values)

    def adjoint(self, values: FloatArray) -> FloatArray:
        return self._factor * self._smoothing.adjoint(self._factor * values)

    def norm(self) -> float:
        return self._smoothing.norm()

    def is_positive(self) -> bool:
        return self._smoothing.is_positive()

    def destroy(self) -> None:
        self._smoothing.destroy()
