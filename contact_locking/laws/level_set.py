"""A rigid foundation as a level set of a function."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import InputError


@dataclass(frozen=True)
class LevelSet:
    """``phi(x) = f(x)/|grad f(x)|``: to first order the distance to the surface ``f = 0``.

    ``function`` maps points (d, k) to f (k,) and its gradient (d, k); f is positive outside.  Where
    f is a distance, ``|grad f| = 1``, this is exact.  Where the gradient vanishes, phi is not
    finite.
    """

    function: Callable[[FloatArray], tuple[FloatArray, FloatArray]]

    def _evaluated(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = self.function(x)
        if not isinstance(found, tuple | list) or np.shape(found[-1]) != x.shape:
            raise InputError("the function of a LevelSet returns f (k,) and its gradient (d, k)")
        return found[0], found[1]

    def slope(self, x: FloatArray) -> FloatArray:
        """``|grad f|`` (k,) at points (d, k)."""
        return np.asarray(np.linalg.norm(self._evaluated(x)[1], axis=0))

    def gap(self, x: FloatArray) -> FloatArray:
        values, gradient = self._evaluated(x)
        return np.asarray(values / np.linalg.norm(gradient, axis=0))

    def contact_normal(self, x: FloatArray) -> FloatArray:
        gradient = self._evaluated(x)[1]
        return np.asarray(-gradient / np.linalg.norm(gradient, axis=0))
