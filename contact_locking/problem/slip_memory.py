"""The memory of friction: where the nodes of a contact stood, and how far they have slid."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.problem.surface import ContactSurface


class SlipMemory:
    """``u_{k-1,tau}`` and the accumulated slip ``s_{k-1} = sum_j |u_{j,tau} - u_{j-1,tau}|``.

    Friction acts on the slip of the present step, ``u_tau - u_{k-1,tau}``, and the friction
    coefficient depends on ``s_k``.  Both memories are zero at the beginning, and in the static
    problem.  ``place`` is ``u_{k-1,tau}`` as a function, for the forms; ``slip`` (k,) is
    ``s_{k-1}`` at the owned nodes of the contact.
    """

    def __init__(self, surface: ContactSurface) -> None:
        count, dim = len(surface.nodes), surface.domain.dim
        self._blocks, self._dim = surface.blocks, dim
        self.place = surface.vector_function(np.zeros((count, dim)), "old_slip")
        self.slip: FloatArray = np.zeros(count)

    @property
    def tangential(self) -> FloatArray:
        """``u_{k-1,tau}`` (k, d) at the nodes."""
        return np.asarray(self.place.x.array.reshape(-1, self._dim)[self._blocks])

    def set(self, tangential: FloatArray, slip: FloatArray) -> None:
        """Replace ``u_{k-1,tau}`` (k, d) and ``s_{k-1}`` (k,); collective."""
        self.place.x.array.reshape(-1, self._dim)[self._blocks] = tangential
        self.place.x.scatter_forward()
        self.slip = np.array(slip)
