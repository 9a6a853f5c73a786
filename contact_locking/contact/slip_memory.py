"""The memory of friction: where the nodes of a contact stood, and how far they have slid."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.contact.surface import ContactSurface


class SlipMemory:
    """``u_{k-1,tau}`` and the accumulated slip ``s_{k-1} = sum_j |u_{j,tau} - u_{j-1,tau}|``.

    Friction acts on the slip of the present step, ``u_tau - u_{k-1,tau}``, and the friction
    coefficient depends on ``s_k``.  Both memories are zero at the beginning, and in the static
    problem.  ``place`` is ``u_{k-1,tau}`` as a function, for the forms; ``slip`` (k,) is
    ``s_{k-1}`` at the owned nodes of the contact.

    On a foundation that moves by ``drag`` (k, d) in the step, the slip is relative to it,
    ``(u - u_{k-1} - drag)_tau``, and ``place`` is ``(u_{k-1} + drag)_tau``.
    """

    def __init__(self, surface: ContactSurface) -> None:
        count, dim = len(surface.nodes), surface.domain.dim
        self._blocks, self._dim = surface.blocks, dim
        self.place = surface.vector_function(np.zeros((count, dim)), "old_slip")
        self.slip: FloatArray = np.zeros(count)
        self.drag: FloatArray = np.zeros((count, dim))
        # u_{k-1}: its tangential part as remembered, and its normal part.
        self._start: FloatArray = np.zeros((count, dim))

    @property
    def tangential(self) -> FloatArray:
        """``u_{k-1,tau}`` (k, d) at the nodes, with the drag of the step."""
        return np.asarray(self.place.x.array.reshape(-1, self._dim)[self._blocks])

    def set(
        self, tangential: FloatArray, slip: FloatArray, normal: FloatArray | float = 0.0
    ) -> None:
        """Set ``u_{k-1,tau}`` (k, d), ``s_{k-1}`` (k,) and ``u_{k-1,nu} nu`` (k, d); collective.

        The normal part matters only where the contact normal changes from step to step.
        """
        self._put(tangential)
        self.slip, self._start = np.array(slip), tangential + normal

    def drag_by(self, drag: FloatArray, normals: FloatArray) -> None:
        """Let the foundation move by ``drag`` (k, d), to contact normals (k, d); collective."""
        self.drag = drag
        place = self._start + drag
        self._put(place - np.sum(place * normals, axis=1)[:, None] * normals)

    def _put(self, tangential: FloatArray) -> None:
        self.place.x.array.reshape(-1, self._dim)[self._blocks] = tangential
        self.place.x.scatter_forward()
