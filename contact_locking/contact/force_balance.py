"""The equilibrium of a free foundation by the penalty laws, for a displacement of the body."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.free_motions import FreeMotion, Travel
from contact_locking.contact.nodal_contact import BoundsInForce
from contact_locking.contact.surface import ContactSurface
from contact_locking.laws.rigid_motion import SmallMotion
from contact_locking.parallel import maximum

# Shorter ways than this share of the displacements are rounding.
_ROUNDING = 1e-16
_MOST_STEPS = 100
# Newton's method has this share of the stiffness of the whole contact beside that of the nodes that
# touch, of which there may be none, and of which one does not stop a turn.
_FLOOR = 1e-9
# A step ends where the slope along it is this share of that at its start, after so many trials.
_SLOPE_SHARE, _TRIALS = 0.5, 60


class Tools(Sequence[FreeMotion]):
    """The free motions of all foundations, with their sizes and equilibrium by the penalty laws.

    The motions of one foundation follow each other.  The methods are collective.
    """

    def __init__(
        self, motions: Sequence[FreeMotion], epsilon: fem.Constant, bounds: BoundsInForce
    ) -> None:
        self._motions, self._travels = tuple(motions), (0.0,) * len(motions)
        groups = itertools.groupby(motions, key=lambda item: item.contact)
        self._balances = [_Balance(tuple(group), epsilon, bounds) for _, group in groups]

    def __len__(self) -> int:
        return len(self._motions)

    def __getitem__(self, number: Any) -> Any:
        return self._motions[number]

    @property
    def travels(self) -> tuple[float, ...]:
        """The size q of each motion; to set them moves the foundations."""
        return self._travels

    @travels.setter
    def travels(self, values: Sequence[float]) -> None:
        self._travels = tuple(map(float, values))
        for balance, sizes in self._of_foundations():
            balance.move(sizes)

    @property
    def forces(self) -> FloatArray:
        """The force F (T,) on the foundations at present."""
        return np.array([tool.force for tool in self])

    @property
    def stiffnesses(self) -> FloatArray:
        """The stiffness k (T,) of the springs at present."""
        return np.array([tool.stiffness for tool in self])

    @property
    def left(self) -> FloatArray:
        """``F - k q`` (T,): the forces that the contacts have to bear."""
        return self.forces - self.stiffnesses * np.array(self._travels)

    @property
    def act(self) -> bool:
        """Whether a free foundation presses on the body, if it is in the way, at present."""
        return any(tool.acts for tool in self)

    def rest(self, u: fem.Function) -> None:
        """Let foundations that no force presses touch the body."""
        found: list[float] = []
        for balance, sizes in self._of_foundations():
            found += sizes if balance.tools[0].acts else balance.touching(u, sizes)
        self.travels = tuple(found)

    def settle(self, u: fem.Function) -> None:
        """Move each foundation to where the penalty laws hold its forces."""
        found: list[float] = []
        for balance, sizes in self._of_foundations():
            found += balance.settled(u, sizes)
        self.travels = tuple(found)

    def borders(
        self, u: fem.Function, floor: float
    ) -> Iterator[tuple[ContactSurface, FloatArray, FloatArray]]:
        """The surface of each foundation, the tractions (m, k, d) of ``B`` at its nodes, and C.

        ``floor`` is a stiffness of the contact that is added to that of the law.
        """
        for balance, sizes in self._of_foundations():
            yield balance.contact.surface, *balance.border(u, sizes, floor)

    def _of_foundations(self) -> Iterator[tuple[_Balance, tuple[float, ...]]]:
        """Each foundation with the sizes of its motions."""
        first = 0
        for balance in self._balances:
            last = first + len(balance.tools)
            yield balance, self._travels[first:last]
            first = last


class _Balance:
    """The sizes q(u) of motions at which pressure (25) and friction (22) hold a foundation.

    The forces of the contact along the motions m_i,

        g_i(q) = -int (p nu - sigma_tau) . m_i,   with u - sum q_i m_i in the place of u,

    are the gradient of a convex function of q, so that ``g_i(q) + k_i q_i = F_i`` has a solution.
    With q(u) the potential of (25) less ``F q - k q^2/2`` is a function of u alone.  It is convex,
    its gradient is the residual of (25) at q(u), and its second derivative is ``K - B C^-1 B^T``
    with the tangent K at a foundation that stands still, ``B = dg/du`` and ``C = dg/dq + k``.
    Without a force the foundation keeps the extent of the body as a distance.
    """

    def __init__(
        self, tools: Sequence[FreeMotion], epsilon: fem.Constant, bounds: BoundsInForce
    ) -> None:
        self.tools, self._epsilon, self._bounds = tools, epsilon, bounds
        self.contact = tools[0].contact

    def move(self, sizes: Sequence[float]) -> None:
        """Move the foundation by the sizes of its motions; collective."""
        moved = [tool.motion.times(size) for tool, size in zip(self.tools, sizes, strict=True)]
        self.contact.move_foundation(sum(moved, SmallMotion.rest(self.contact.surface.domain.dim)))

    def touching(
        self, u: fem.Function, sizes: Sequence[float], distance: float = 0.0
    ) -> tuple[float, ...]:
        """The sizes where the foundation is at a distance from the body along its travel."""
        travel = self.tools[0]
        if not isinstance(travel, Travel):
            return tuple(sizes)
        self.move((0.0, *sizes[1:]))
        return (travel.touching(u) - distance, *sizes[1:])

    def settled(self, u: fem.Function, start: Sequence[float]) -> tuple[float, ...]:
        """The sizes q(u), by Newton's method; collective."""
        if not self.tools[0].acts:
            return self.touching(u, start, self.contact.surface.domain.extent)
        state = _State(self, u, start)
        sizes = state.start.copy()
        forces = np.array([tool.force for tool in self.tools])
        springs = np.array([tool.stiffness for tool in self.tools])

        def left_at(sizes: FloatArray) -> tuple[FloatArray, FloatArray]:
            found, slopes, _ = state.at(sizes)
            return forces - springs * sizes - found, slopes + np.diag(springs)

        left, slopes = left_at(sizes)
        for _ in range(_MOST_STEPS):
            step = np.asarray(np.linalg.solve(slopes + _FLOOR * state.whole, left), dtype=float)
            gain = float(left @ step)
            moved = state.way(step)
            if not gain > 0.0 or moved <= _ROUNDING * state.size:
                break
            t = self._length_of(lambda t: float(left_at(sizes + t * step)[0] @ step), gain)  # noqa: B023
            sizes = sizes + t * step
            left, slopes = left_at(sizes)
        return tuple(sizes)

    def _length_of(self, slope: Any, start: float) -> float:
        """The length of a step at which the work left along it is a share of that at its start."""
        low, high, t = 0.0, np.inf, 1.0
        for _ in range(_TRIALS):
            left = slope(t)
            if abs(left) <= _SLOPE_SHARE * start:
                break
            low, high = (t, high) if left > 0.0 else (low, t)
            t = 0.5 * (low + high) if np.isfinite(high) else 4.0 * t
        return t

    def border(
        self, u: fem.Function, sizes: Sequence[float], floor: float
    ) -> tuple[FloatArray, FloatArray]:
        """The tractions (m, k, d) of ``B`` at the nodes, and C (m, m); collective."""
        count = len(self.tools)
        if not self.tools[0].acts:
            return np.zeros((count, *self.contact.normals.shape)), np.zeros((count, count))
        state = _State(self, u, sizes)
        _, corner, tractions = state.at(state.start, floor)
        return tractions, corner + np.diag([tool.stiffness for tool in self.tools])


class _State:
    """The arguments of the laws at the nodes of a free foundation's contact; collective."""

    def __init__(self, balance: _Balance, u: fem.Function, start: Sequence[float]) -> None:
        tools, contact = balance.tools, balance.contact
        self._contact, self._comm = contact, contact.surface.domain.comm
        #: The present sizes of the motions (m,).
        self.start = np.array(start)
        self._epsilon = float(balance._epsilon.value)
        self._excess = contact.split(u)[0] - contact.gaps
        self._slip = contact.increment(u)
        normals = contact.normals
        fields = np.array([tool.field for tool in tools])
        self._normals, self._along = normals, np.einsum("mkd,kd->mk", fields, normals)
        self._across = fields - self._along[..., None] * normals
        self._bound = balance._bounds[contact]
        self._length = float(balance._bounds.lengths[contact].value)
        self._weights = contact.surface.weights
        self._pressed = self._weights * contact.free
        #: The size of the displacements that excesses and slips are differences of.
        self.size = maximum(self._comm, np.abs(u.x.array)) + maximum(
            self._comm, np.abs(contact.gaps)
        )
        self._fields = fields

    def way(self, step: FloatArray) -> float:
        """The largest displacement of the foundation by a step of the sizes."""
        moved = np.einsum("m,mkd->kd", step, self._fields)
        return maximum(self._comm, np.abs(moved))

    @property
    def whole(self) -> FloatArray:
        """The slopes (m, m) of the forces if all nodes touch."""
        found = np.einsum("ik,jk,k->ij", self._along, self._along, self._pressed) / self._epsilon
        return np.asarray(self._comm.allreduce(found))

    def at(
        self, sizes: FloatArray, floor: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The forces g (m,), their slopes (m, m), and the tractions (m, k, d) that ``-m`` makes.

        ``sizes`` are those of the motions, and ``floor`` is a stiffness that contact has besides.
        """
        step, across = sizes - self.start, self._across
        excess = self._excess - step @ self._along
        slip = self._slip - np.einsum("m,mkd->kd", step, across)
        size = np.sqrt(np.sum(slip**2, axis=1) + self._length**2)
        inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
        rubs, shares = self._bound * inverse, np.einsum("kd,mkd->mk", slip, across)
        normal = -self._along * ((excess > 0.0) / self._epsilon + floor)
        bends = rubs[:, None] * (across - (shares * inverse**2)[..., None] * slip)
        forces = -self._along @ (self._pressed * np.maximum(excess, 0.0)) / self._epsilon
        forces -= shares @ (self._weights * rubs)
        slopes = -np.einsum("ik,jk,k->ij", self._along, normal, self._pressed)
        slopes += np.einsum("ikd,jkd,k->ij", across, bends, self._weights)
        whole = self._comm.allreduce(np.vstack([forces, slopes]))
        tractions = (self._contact.free * normal)[..., None] * self._normals - bends
        return whole[0], whole[1:], tractions
