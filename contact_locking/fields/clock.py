"""The present time of a problem whose loads and gaps depend on the time t."""

from __future__ import annotations

from collections.abc import Sequence

import dolfinx
import numpy as np
from dolfinx import fem

_ROUNDING = 1e-12
# Data are sampled at so many times of a process, the first and the last among them.
_TIMES = 8


class Clock:
    """The time t: ``now`` for values at points, ``constant`` for the forms.

    ``planned`` are the times of a process, which begins at 0 or at the first of them.
    ``some_times`` are some of these, or the present time of a static problem, at which data are
    sampled.
    """

    def __init__(
        self,
        mesh: dolfinx.mesh.Mesh,
        start: float = 0.0,
        planned: Sequence[float] = (),
    ) -> None:
        self.planned = tuple(planned)
        #: The time before the first step.
        self.start = min(0.0, start)
        places = np.linspace(0, len(planned) - 1, min(len(planned), _TIMES))
        self.some_times = [planned[round(place)] for place in places] or [float(start)]
        self.constant = fem.Constant(mesh, float(start))

    @property
    def now(self) -> float:
        return float(self.constant.value)

    def set(self, time: float) -> None:
        self.constant.value = time


class LargestSoFar:
    """The largest size that a quantity has had at any time so far.

    A size below 1e-12 of the largest is zero with rounding, as that of sin(pi*t) is at t = 1.
    """

    def __init__(self) -> None:
        self._most = 0.0

    def hides(self, size: float) -> bool:
        """Whether the present ``size`` >= 0, which counts from now on, is zero with rounding."""
        self._most = max(self._most, size)
        return size <= _ROUNDING * self._most
