"""The equilibrium of a pushed foundation by the penalty laws, for a displacement of the body."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.pushed_foundation import PushedFoundation
from contact_locking.parallel import maximum

# The forces balance to this share of the force, or as rounding permits.
_TOLERANCE = 1e-14
# Shorter ways than this share of the displacements are rounding.
_ROUNDING = 1e-16
_MOST_STEPS = 100


class Tools(Sequence[PushedFoundation]):
    """The pushed foundations of a problem, with travels and equilibrium by the penalty laws."""

    def __init__(self, tools: Sequence[PushedFoundation], epsilon: fem.Constant) -> None:
        self._tools = tuple(tools)
        self.balances = [
            ToolBalance(tool, epsilon, tool.contact.surface.domain.extent) for tool in tools
        ]

    def __len__(self) -> int:
        return len(self._tools)

    def __getitem__(self, number: Any) -> Any:
        return self._tools[number]

    @property
    def travels(self) -> tuple[float, ...]:
        """The travel of each foundation; to set them is collective."""
        return tuple(tool.travel for tool in self)

    @travels.setter
    def travels(self, values: Sequence[float]) -> None:
        for tool, value in zip(self, values, strict=True):
            tool.travel = value

    def settle(self, u: fem.Function) -> None:
        """Move each foundation to where the penalty laws hold its force; collective."""
        for balance in self.balances:
            balance.settle(u)


class ToolBalance:
    """The travel q(u) at which pressure (25) and friction (22) hold the force of a foundation.

    The force of the foundation along d,

        g(q) = -int (p nu - sigma_tau) . d,   with u - q d in the place of u,

    grows with q, so that ``g(q) = F`` has one solution.  With q(u) the potential of (25) less
    ``F q`` is a function of u alone.  It is convex, its gradient is the residual of (25) at q(u),
    and its second derivative is ``K - B B^T/c`` with the tangent K at a travel that stands still,
    ``B = dg/du`` and ``c = dg/dq``.  Without a force the foundation keeps a distance of ``length``.
    """

    def __init__(self, tool: PushedFoundation, epsilon: fem.Constant, length: float) -> None:
        self.tool, self._epsilon, self._length = tool, epsilon, length

    def settle(self, u: fem.Function) -> None:
        """Move the foundation to q(u); collective."""
        tool = self.tool
        if not tool.pushes:
            return tool.touch(u, self._length)
        state, travel = _State(self, u), tool.travel
        # The solution is between low and high.
        low, high = -np.inf, np.inf
        for trial in range(_MOST_STEPS):
            force, slope = state.at(travel)
            left = tool.force - force
            low, high = (travel, high) if left > 0.0 else (low, travel)
            step = left / slope if slope > 0.0 else np.inf
            if abs(left) <= _TOLERANCE * tool.force or abs(step) <= _ROUNDING * state.size:
                break
            if not low < travel + step < high:
                if np.isfinite(high - low):
                    step = 0.5 * (low + high) - travel
                else:
                    # Where all of the contact is pressed, or none, by more and more.
                    reach = 2.0**trial * state.size
                    step = state.reach(tool.force) + reach if left > 0.0 else -reach
            travel += step
        tool.travel = travel

    def border(self, u: fem.Function, floor: float) -> tuple[FloatArray, float]:
        """The tractions (k, d) of ``B`` at the nodes, and c, at the present travel; collective.

        ``floor`` is a stiffness of the contact that is added to that of the law.
        """
        tool, contact = self.tool, self.tool.contact
        if not tool.pushes:
            return np.zeros_like(contact.normals), 0.0
        return _State(self, u).block(floor)


class _State:
    """The arguments of the laws at the nodes of a pushed foundation's contact; collective."""

    def __init__(self, balance: ToolBalance, u: fem.Function) -> None:
        tool, contact = balance.tool, balance.tool.contact
        self._contact, self._comm = contact, contact.surface.domain.comm
        self._travel = tool.travel
        self._epsilon = float(balance._epsilon.value)
        self._excess = contact.split(u)[0] - contact.gaps
        self._slip = contact.increment(u)
        normals = contact.normals
        self._normals, self._along = normals, normals @ tool.direction
        self._across = tool.direction - self._along[:, None] * normals
        self._bound, self._length = contact.bounds, float(contact.regularisation.value)
        self._weights = contact.surface.weights
        self._pressed = self._weights * contact.free
        facing = -np.minimum(self._along, 0.0)
        self._all = self._sum(self._pressed * facing**2) / self._epsilon
        towards = contact.free & (facing > 0.0)
        deepest = float(np.max(-self._excess[towards] / facing[towards], initial=0.0))
        self._farthest = max(self._comm.allgather(deepest))
        #: The size of the displacements that excesses and slips are differences of.
        self.size = maximum(self._comm, np.abs(u.x.array)) + maximum(
            self._comm, np.abs(contact.gaps)
        )

    def reach(self, force: float) -> float:
        """The way until all nodes that the foundation faces carry a force without friction."""
        return self._farthest + force / (self._all or 1.0)

    def at(self, travel: float) -> tuple[float, float]:
        """The force g and its slope at a travel."""
        step = travel - self._travel
        excess = self._excess - step * self._along
        slip = self._slip - step * self._across
        size = np.sqrt(np.sum(slip**2, axis=1) + self._length**2)
        rubbing, share = self._weights * self._bound, np.einsum("ki,ki->k", slip, self._across)
        force = -self._pressed @ (np.maximum(excess, 0.0) * self._along) / self._epsilon
        slope = self._pressed @ ((excess > 0.0) * self._along**2) / self._epsilon
        with np.errstate(divide="ignore", invalid="ignore"):
            slides = rubbing > 0.0
            force -= float(np.sum((rubbing * share / size)[slides]))
            across = np.sum(self._across**2, axis=1)
            bends = rubbing * (across / size - share**2 / size**3)
            slope += float(np.sum(bends[slides]))
        force, slope = self._comm.allreduce(np.array([force, slope]))
        return float(force), float(slope)

    def block(self, floor: float) -> tuple[FloatArray, float]:
        """The tractions that the blocks of the laws make of ``-d``, and c."""
        normal = -self._along * ((self._excess > 0.0) / self._epsilon + floor)
        size = np.sqrt(np.sum(self._slip**2, axis=1) + self._length**2)
        share = np.einsum("ki,ki->k", self._slip, self._across)
        with np.errstate(divide="ignore", invalid="ignore"):
            bends = self._bound[:, None] * (
                self._across / size[:, None] - (share / size**3)[:, None] * self._slip
            )
        bends[self._bound == 0.0] = 0.0
        free = self._contact.free
        tractions = (free * normal)[:, None] * self._normals - bends
        products = -(free * normal) * self._along + np.sum(bends * self._across, axis=1)
        return tractions, self._sum(self._weights * products)

    def _sum(self, values: FloatArray) -> float:
        return float(self._comm.allreduce(float(np.sum(values))))
