"""Sets of strains at the points of the strains, with their multipliers, as arrays."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray


class SetAtPoints:
    """One set of strains at the points of the strains, with its multiplier y.

    ``limit`` (k,) is M, and ``size`` (k,) is ``|y|``.  ``pulling`` (k,) is the negative part of the
    multiplier of a half space, which has none in a solution.  ``strength`` (k,) is the norm of y,
    ``2n`` times the excess by the penalty law.
    """

    def __init__(
        self,
        measured: Callable[[fem.Function], FloatArray],
        limit: FloatArray,
        multiplier: FloatArray,
    ) -> None:
        #: ``L (eps(w) - eps_0)`` of a displacement w: (k, d, d), or (k,) for a half space.
        self.measured = measured
        self.limit, self._multiplier = limit, multiplier
        self._measure_multiplier()

    def _measure_multiplier(self) -> None:
        is_scalar = self._multiplier.ndim == 1
        self.size = self.reach(self._multiplier) if not is_scalar else np.abs(self._multiplier)
        self.pulling = np.maximum(-self._multiplier if is_scalar else 0.0 * self.size, 0.0)
        self.strength = self.size

    @property
    def largest(self) -> FloatArray:
        """M (k,) with 0 in place of an infinite M, where there is no multiplier."""
        return np.where(np.isfinite(self.limit), self.limit, 0.0)

    @property
    def support(self) -> FloatArray:
        """``M |y|`` (k,): the largest work of y at a strain of the set."""
        return self.largest * self.size

    def reach(self, measured: FloatArray) -> FloatArray:
        """``|L eps|``, or ``L eps`` for a half space: (k,) of what is measured."""
        return np.linalg.norm(measured, axis=(1, 2)) if measured.ndim > 1 else measured

    def excess(self, measured: FloatArray) -> FloatArray:
        """``[|L eps| - M]^+``, or ``[L eps - M]^+`` for a half space: (k,) of what is measured."""
        return np.maximum(self.reach(measured) - self.limit, 0.0)

    def most_work(self, measured: FloatArray) -> FloatArray:
        """``|y| max(M, |L eps|)`` (k,): the work of y at what is measured, if y follows its law."""
        norm = self.reach(measured)
        # A point without a limit must not turn M |y| into inf times 0.
        return self.size * np.maximum(np.where(np.isfinite(self.limit), self.limit, norm), norm)

    def work(self, measured: FloatArray) -> FloatArray:
        """``y : L eps`` (k,) of what is measured."""
        if measured.ndim == 1:
            return self._multiplier * measured
        return np.einsum("kij,kij->k", self._multiplier, measured)


class PrincipalAtPoints(SetAtPoints):
    """A limit of the largest principal strain, ``eps_I`` in the place of ``|L eps|``.

    ``size`` is ``tr y`` and ``strength`` the Frobenius norm; ``pulling`` is what is negative of the
    eigenvalues of y, of which a solution has none.
    """

    def _measure_multiplier(self) -> None:
        self._eigenvalues = np.linalg.eigvalsh(self._multiplier)
        self.size = np.abs(self._eigenvalues).sum(axis=1)
        self.pulling = np.maximum(-self._eigenvalues[:, 0], 0.0)
        self.strength = np.linalg.norm(self._multiplier, axis=(1, 2))

    def reach(self, measured: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.eigvalsh(measured)[:, 1])

    def excess(self, measured: FloatArray) -> FloatArray:
        beyond = np.linalg.eigvalsh(measured) - self.limit[:, None]
        return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=1))

    def most_work(self, measured: FloatArray) -> FloatArray:
        """``sum y_i max(M, eps_i)`` with the eigenvalues in the order of their size.

        It is ``y : eps`` at least, and equal where y stretches along the strain beyond M alone.
        """
        strains = np.linalg.eigvalsh(measured)
        limit = self.limit[:, None]
        reached = np.maximum(np.where(np.isfinite(limit), limit, strains), strains)
        return np.asarray(np.sum(np.abs(self._eigenvalues) * reached, axis=1))
