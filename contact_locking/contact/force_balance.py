"""The equilibrium of a free foundation by the penalty laws, for a displacement of the body."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.nodal_contact import BoundsInForce
from contact_locking.contact.surface import ContactSurface
from contact_locking.contact.travel import Travel
from contact_locking.parallel import maximum

# Shorter ways than this share of the displacements are rounding.
_ROUNDING = 1e-16
_MOST_STEPS = 100
# Newton's method has this share of the stiffness of the whole contact beside that of the nodes that
# touch, of which there may be none.
_FLOOR = 1e-9
# A step ends where the slope along it is this share of that at its start, after so many trials.
_SLOPE_SHARE, _TRIALS = 0.5, 60


class Tools(Sequence[Travel]):
    """Travels, sizes and equilibrium by the penalty laws of all free foundations; collective."""

    def __init__(
        self, tools: Sequence[Travel], epsilon: fem.Constant, bounds: BoundsInForce
    ) -> None:
        self._tools, self._travels = tuple(tools), (0.0,) * len(tools)
        self._balances = [_Balance(tool, epsilon, bounds) for tool in tools]

    def __len__(self) -> int:
        return len(self._tools)

    def __getitem__(self, number: Any) -> Any:
        return self._tools[number]

    @property
    def travels(self) -> tuple[float, ...]:
        """The size q of each travel; to set them moves the foundations."""
        return self._travels

    @travels.setter
    def travels(self, values: Sequence[float]) -> None:
        self._travels = tuple(map(float, values))
        for tool, size in zip(self, self._travels, strict=True):
            tool.contact.move_foundation(size * tool.direction)

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
        self.travels = tuple(
            size if balance.tool.acts else balance.touching(u)
            for balance, size in zip(self._balances, self._travels, strict=True)
        )

    def settle(self, u: fem.Function) -> None:
        """Move each foundation to where the penalty laws hold its forces."""
        pairs = zip(self._balances, self._travels, strict=True)
        self.travels = tuple(balance.settled(u, size) for balance, size in pairs)

    def borders(
        self, u: fem.Function, floor: float
    ) -> Iterator[tuple[ContactSurface, FloatArray, float]]:
        """The surface of each foundation, the tractions (k, d) of ``B`` at its nodes, and C.

        ``floor`` is a stiffness of the contact that is added to that of the law.
        """
        for balance, size in zip(self._balances, self._travels, strict=True):
            yield balance.tool.contact.surface, *balance.border(u, size, floor)


class _Balance:
    """The travel q(u) at which pressure (25) and friction (22) hold a foundation.

    The force of the contact along the direction d,

        g(q) = -int (p nu - sigma_tau) . d,   with u - q d in the place of u,

    is the derivative of a convex function of q, so that ``g(q) + k q = F`` has a solution.  With
    q(u) the potential of (25) less ``F q - k q^2/2`` is a function of u alone.  It is convex, its
    gradient is the residual of (25) at q(u), and its second derivative is ``K - B C^-1 B^T`` with
    the tangent K at a foundation that stands still, ``B = dg/du`` and ``C = dg/dq + k``.  Without a
    force the foundation keeps the extent of the body as a distance.
    """

    def __init__(self, tool: Travel, epsilon: fem.Constant, bounds: BoundsInForce) -> None:
        self.tool, self._epsilon, self._bounds = tool, epsilon, bounds

    def touching(self, u: fem.Function) -> float:
        """The travel where the foundation touches the body; collective."""
        self.tool.contact.move_foundation(np.zeros_like(self.tool.direction))
        return self.tool.touching(u)

    def settled(self, u: fem.Function, start: float) -> float:
        """The travel q(u), by Newton's method; collective."""
        tool = self.tool
        if not tool.acts:
            return self.touching(u) - tool.contact.surface.domain.extent
        state, travel = self._state(u, start), start

        def left_at(travel: float) -> tuple[float, float]:
            force, slope, _ = state.at(travel)
            return tool.force - tool.stiffness * travel - force, slope + tool.stiffness

        left, slope = left_at(travel)
        for _ in range(_MOST_STEPS):
            step = left / (slope + _FLOOR * state.whole)
            if not left * step > 0.0 or abs(step) * state.reach <= _ROUNDING * state.size:
                break
            t = _length_of(lambda t: left_at(travel + t * step)[0] * step, left * step)  # noqa: B023
            travel += t * step
            left, slope = left_at(travel)
        return travel

    def border(self, u: fem.Function, travel: float, floor: float) -> tuple[FloatArray, float]:
        """The tractions (k, d) of ``B`` at the nodes, and C; collective."""
        if not self.tool.acts:
            return np.zeros_like(self.tool.contact.normals), 0.0
        _, slope, tractions = self._state(u, travel).at(travel, floor)
        return tractions, slope + self.tool.stiffness

    def _state(self, u: fem.Function, travel: float) -> _State:
        contact = self.tool.contact
        epsilon, length = float(self._epsilon.value), self._bounds.lengths[contact]
        return _State(self.tool, u, travel, (epsilon, length), self._bounds[contact])


def _length_of(slope: Callable[[float], float], start: float) -> float:
    """The length of a step at which the work left along it is a share of that at its start."""
    low, high, t = 0.0, np.inf, 1.0
    for _ in range(_TRIALS):
        left = slope(t)
        if abs(left) <= _SLOPE_SHARE * start:
            break
        low, high = (t, high) if left > 0.0 else (low, t)
        t = 0.5 * (low + high) if np.isfinite(high) else 4.0 * t
    return t


class _State:
    """The arguments of the laws at the nodes of a free foundation's contact; collective.

    ``travel`` is the present one, ``lengths`` are the compliance of contact and the regularisation
    of friction, and ``bound`` (k,) is that of friction.
    """

    def __init__(
        self,
        tool: Travel,
        u: fem.Function,
        travel: float,
        lengths: tuple[float, float],
        bound: FloatArray,
    ) -> None:
        contact = tool.contact
        self._contact, self._comm, self._start = contact, contact.surface.domain.comm, travel
        self._epsilon, self._length = lengths
        self._bound = bound
        self._excess, self._slip = contact.split(u)[0] - contact.gaps, contact.increment(u)
        self._normals, self._along = contact.normals, tool.facing
        self._across = tool.direction - self._along[:, None] * self._normals
        self._weights = contact.surface.weights
        self._pressed = self._weights * contact.free
        #: The size of the displacements that excesses and slips are differences of.
        self.size = maximum(self._comm, np.abs(u.x.array))
        self.size += maximum(self._comm, np.abs(contact.gaps))
        #: The largest component of the direction.
        self.reach = float(np.abs(tool.direction).max())

    @property
    def whole(self) -> float:
        """The slope of the force if all nodes touch."""
        return float(self._comm.allreduce(self._along**2 @ self._pressed) / self._epsilon)

    def at(self, travel: float, floor: float = 0.0) -> tuple[float, float, FloatArray]:
        """The force g, its slope, and the tractions (k, d) that ``-d`` makes; collective.

        ``floor`` is a stiffness that contact has besides.
        """
        step, along, across = travel - self._start, self._along, self._across
        excess, slip = self._excess - step * along, self._slip - step * across
        size = np.sqrt(np.sum(slip**2, axis=1) + self._length**2)
        inverse = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
        rubs, shares = self._bound * inverse, np.sum(slip * across, axis=1)
        normal = -along * ((excess > 0.0) / self._epsilon + floor)
        bends = rubs[:, None] * (across - (shares * inverse**2)[:, None] * slip)
        force = -along @ (self._pressed * np.maximum(excess, 0.0)) / self._epsilon
        force -= shares @ (self._weights * rubs)
        slope = -(along * normal) @ self._pressed
        slope += np.sum(across * bends, axis=1) @ self._weights
        force, slope = self._comm.allreduce(np.array([force, slope]))
        tractions = (self._contact.free * normal)[:, None] * self._normals - bends
        return float(force), float(slope), tractions
