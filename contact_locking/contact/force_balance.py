"""The travels of the free foundations of a problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import FloatArray
from contact_locking.contact.travel import Travel


class Tools(Sequence[Travel]):
    """All free foundations with their travels at present."""

    def __init__(self, tools: Sequence[Travel]) -> None:
        self._tools, self._travels = tuple(tools), (0.0,) * len(tools)

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
        """Let foundations that no force presses touch the body; collective."""
        travels = []
        for tool, size in zip(self, self._travels, strict=True):
            if not tool.acts:
                tool.contact.move_foundation(np.zeros_like(tool.direction))
            travels.append(size if tool.acts else tool.touching(u))
        self.travels = tuple(travels)
