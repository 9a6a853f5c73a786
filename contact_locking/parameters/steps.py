"""The steps of a process: the times at which the problem is solved."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Annotated

from pydantic import Field, model_validator

from .base import Fault, Section, entry, refuse_if
from .values import Number, Positive, StepCount
from .wording import show

_MOST_STEPS = 100_000
# A step may be halved so often, unless the file gives the least step.
_HALVINGS = 6


class StepParameters(Section):
    """Times t_1 < t_2 < ..., with steps of equal length or listed."""

    to: Positive | None = entry(
        None, "the last time, for steps of equal length from t = 0", "time", optional=True
    )
    count: StepCount | None = entry(None, "number of steps up to `to`", "1", optional=True)
    times: Annotated[tuple[Number, ...], Field(max_length=_MOST_STEPS)] | None = entry(
        None, "the times in place of `to` and `count`, ascending", "time", optional=True
    )
    least: Positive | None = entry(
        None,
        "the shortest step: a step that does not converge is halved down to this length; "
        "null: 1/64 of the step",
        "time",
        optional=True,
    )

    @model_validator(mode="after")
    def _check(self) -> StepParameters:
        refuse_if(self._faults())
        return self

    @property
    def planned(self) -> tuple[float, ...]:
        """The times t_1 < t_2 < ... of the steps."""
        if self.times is not None:
            return self.times
        assert self.to is not None and self.count is not None
        return tuple(self.to * k / self.count for k in range(1, self.count + 1))

    @property
    def start(self) -> float:
        """The time before the first step: 0, or ``t_1`` if that is earlier."""
        return min(0.0, self.planned[0])

    def least_after(self, length: float) -> float:
        """The shortest step that halving may make of a step of the given length."""
        return length / 2**_HALVINGS if self.least is None else self.least

    def _faults(self) -> Iterator[Fault]:
        if self.times is None:
            if self.to is None or self.count is None:
                yield Fault((), "give `to` and `count`, such as {to: 1, count: 20}, or `times`")
        elif self.to is not None or self.count is not None:
            yield Fault(("times",), "give either `times`, or `to` and `count`")
        elif not self.times:
            yield Fault(("times",), "must have one time at least")
        else:
            for first, second in itertools.pairwise(self.times):
                if not first < second:
                    message = f"must ascend, but {show(second)} follows {show(first)}"
                    yield Fault(("times",), message)
                    return
