"""Steps by the factors of a tangent whose half lines have changed at few points since."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.solver.interior_point.family import Reaction
from contact_locking.solver.interior_point.half_lines import HalfLines
from contact_locking.solver.interior_point.tangent import Tangent

# In 2D a matrix with its factorisation takes as long as some eight back-substitutions, in 3D as
# tens of them.
_FEW = 8
# The least singular value of the small matrix.  Where a node is let go, it is the ratio of the
# stiffness without contact to that with it, some 1e-7; below this the step has no digits left.
_LEAST = 1e-10


class FewChanges:
    """``K'^-1 r`` for ``K' = K + sum_j B_j d_j L_j`` with the factors of K (Sherman, Morrison,
    Woodbury): ``du = y - Z (I + d L Z)^-1 d L y``, ``y = K^-1 r``, ``Z = K^-1 B``.

    ``L_j u`` is what a point j of the ``families`` sees, ``B_j`` its adjoint with the weight of the
    point, and ``d_j`` the change of its stiffness since the tangent was set up.
    """

    def __init__(self, tangent: Tangent, families: Sequence[HalfLines], accuracy: float) -> None:
        self._tangent, self._families, self._accuracy = tangent, families, accuracy
        self._factorised = [family.stiffness.copy() for family in families]
        # By rank, family and point.
        self._answers: dict[tuple[int, int, int], FloatArray] = {}
        self._points: list[tuple[int, int, int]] = []
        self._changes: FloatArray = np.zeros(0)
        self._matrix: FloatArray = np.zeros((0, 0))

    def take(self) -> bool:
        """Take the present stiffnesses; False where they have changed too much; collective."""
        comm, mine = self._tangent.comm, []
        for number, (family, before) in enumerate(
            zip(self._families, self._factorised, strict=True)
        ):
            change = family.stiffness - before
            points = np.flatnonzero(change)
            mine += [((comm.rank, number, int(j)), float(change[j])) for j in points]
        every = [item for items in comm.allgather(mine) for item in items]
        if len(every) > _FEW:
            return False
        self._points = [point for point, _ in every]
        self._changes = np.array([change for _, change in every])
        for rank, number, j in self._points:
            if (rank, number, j) in self._answers:
                continue
            family = self._families[number]
            unit = np.zeros_like(family.stiffness)
            unit[j : j + 1] = rank == comm.rank
            answer = -self._tangent.respond([Reaction(family, unit)], self._accuracy)
            self._answers[rank, number, j] = answer
        seen = [self._see(self._answers[point]) for point in self._points]
        size = len(every)
        self._matrix = np.eye(size) + self._changes[:, None] * np.reshape(seen, (size, size)).T
        return size == 0 or bool(np.linalg.svd(self._matrix, compute_uv=False)[-1] > _LEAST)

    def correct(self, step: FloatArray) -> FloatArray:
        """The step by ``K'`` for one by K; collective."""
        if not self._points:
            return step
        shares = np.linalg.solve(self._matrix, self._changes * self._see(step))
        # Every rank takes the same step, to the last digit.
        shares = self._tangent.comm.bcast(shares)
        answers = [self._answers[point] for point in self._points]
        return np.asarray(step - sum(q * z for q, z in zip(shares, answers, strict=True)))

    def _see(self, displacement: FloatArray) -> FloatArray:
        """What the changed points see, on every rank; collective."""
        comm = self._tangent.comm
        seen = [family.see(displacement) for family in self._families]
        local = [seen[n][j] if rank == comm.rank else 0.0 for rank, n, j in self._points]
        return np.asarray(comm.allreduce(np.array(local)))
