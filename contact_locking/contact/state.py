"""The memory of friction at one contact between two steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.laws.rigid_motion import RigidMotion, SmallMotion


@dataclass(frozen=True)
class ContactState:
    """``u_{k-1}`` and the accumulated slip ``s_{k-1} = sum_j |u_{j,tau} - u_{j-1,tau}|``.

    Friction acts on the slip of the present step, ``u_tau - u_{k-1,tau}``, and the friction
    coefficient depends on ``s_k``.  ``place`` (k, d) is ``u_{k-1}`` and ``slip`` (k,) is
    ``s_{k-1}`` at the owned nodes of the contact.  ``travel`` is how far forces
    had moved the foundation, and ``motion`` is where the foundation itself was.  All are zero at
    the beginning, and in a static problem.  ``displacement`` are the values of
    ``u_{k-1}`` at all local dofs, from which bodies are paired anew; it is None at the beginning,
    and for others.
    """

    place: FloatArray
    slip: FloatArray
    travel: SmallMotion
    motion: RigidMotion
    displacement: FloatArray | None = None

    @classmethod
    def at_rest(cls, nodes: int, dim: int) -> ContactState:
        """Nothing has moved."""
        nothing = SmallMotion.rest(dim), RigidMotion.rest(dim)
        return cls(np.zeros((nodes, dim)), np.zeros(nodes), *nothing)
