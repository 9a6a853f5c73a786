"""The penalty laws of contact (25) and friction (22) at the points of a contact."""

from __future__ import annotations

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import BoundsInForce, NodalContact


class PenaltyLaws:
    """Pressure, friction, their energy and their stiffness at a displacement u; collective to make.

        p = [u_nu - gap]^+/eps,      -sigma_tau = G s/sqrt(|s|^2 + delta^2)

    with the slip s of the step, the friction bound G in force and its length delta.  ``epsilon`` is
    eps, a length over a stress.
    """

    def __init__(
        self, contact: NodalContact, u: fem.Function, epsilon: float, bounds: BoundsInForce
    ) -> None:
        self._contact, self._epsilon = contact, epsilon
        self._bound, length = bounds[contact], float(bounds.lengths[contact].value)
        normal, tangential = contact.split(u)
        self._depth = np.maximum(normal - contact.gaps, 0.0)
        self._slip = tangential - contact.references
        self._size = np.sqrt(np.sum(self._slip**2, axis=1) + length**2)
        rubs = np.zeros_like(self._size)
        #: The secant ``G/sqrt(|s|^2 + delta^2)`` (k,), 0 where nothing slips without a length.
        self._secant = np.divide(self._bound, self._size, out=rubs, where=self._size > 0.0)

    @property
    def pressure(self) -> FloatArray:
        """The pressure p (k,)."""
        return np.asarray(self._depth / self._epsilon)

    @property
    def friction(self) -> FloatArray:
        """The friction ``-sigma_tau`` (k, d)."""
        return np.asarray(self._secant[:, None] * self._slip)

    def energy(self) -> float:
        """``int [u_nu - gap]^+^2/(2 eps) + G sqrt(|s|^2 + delta^2)``; collective."""
        density = 0.5 * self._depth * self.pressure + self._bound * self._size
        return float(self._contact.surface.integral(density))

    def forces(self) -> FloatArray:
        """``int p v_nu - sigma_tau . v_tau`` at the owned dofs; collective."""
        normals, friction = self._contact.normals, self.friction
        friction = friction - np.sum(friction * normals, axis=1)[:, None] * normals
        tractions = self.pressure[:, None] * normals + friction
        weights = self._contact.surface.weights
        return self._contact.surface.operator.forces(weights[:, None] * tractions)

    def stiffness(self, floor: float) -> FloatArray:
        """The derivative (k, d, d) of the forces, with weights, by the values of u at the points.

        All points have ``floor`` as a stiffness along the normal besides.
        """
        contact = self._contact
        normals = contact.normals
        square = normals[:, :, None] * normals[:, None, :]
        along = self._slip / np.where(self._size > 0.0, self._size, 1.0)[:, None]
        along = along - np.sum(along * normals, axis=1)[:, None] * normals
        bends = np.eye(normals.shape[1]) - square - along[:, :, None] * along[:, None, :]
        stiffness = ((self._depth > 0.0) / self._epsilon + floor)[:, None, None] * square
        stiffness += self._secant[:, None, None] * bends
        return np.asarray(contact.surface.weights[:, None, None] * stiffness)
