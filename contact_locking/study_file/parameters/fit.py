"""Measured curves, and the numbers of the file that are fitted to them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from contact_locking.values.concept import Concept, Fault, entry
from contact_locking.values.kinds import File, Integer, Number, NumberOrInfinite, Text

_MOST = 100


class Curve(Concept):
    """The rows of a CSV file, and the keys that differ in its experiment."""

    file: File = entry(..., "a CSV file with a row of column names, relative to the study file")
    set: dict[str, Any] = entry(
        {}, "keys of the study file with their values in this experiment, as contact.gap: 0.1"
    )


def _curves(value: Any) -> Any:
    """A list of curves, also of the name of one file, or of names."""
    entries = value if isinstance(value, list | tuple) else [value]
    return [{"file": one} if isinstance(one, str) else one for one in entries]


class FittedNumber(Concept):
    """Where the search for a number begins, and what it is searched between."""

    start: Number | None = entry(None, "the first value; null: that of the file")
    bounds: tuple[NumberOrInfinite, NumberOrInfinite] | None = entry(
        None, "the least and the largest value; null: none, or positive values with scale: log"
    )
    scale: Literal["linear", "log"] = entry(
        "linear", "log: the search takes the logarithm, for numbers of unknown magnitude"
    )

    @property
    def limits(self) -> tuple[float, float]:
        """The least and the largest value."""
        if self.bounds is not None:
            return self.bounds
        return (0.0 if self.scale == "log" else -math.inf), math.inf

    def _faults(self) -> Iterator[Fault]:
        least, largest = self.limits
        if not least < largest:
            yield Fault(("bounds",), f"must ascend, but {largest:g} follows {least:g}")
        elif self.scale == "log" and least < 0.0:
            yield Fault(("bounds",), f"must not be negative with scale: log, as {least:g} is")
        elif self.start is not None and not (least <= self.start <= largest):
            yield Fault(("start",), f"must be within the bounds, {least:g} to {largest:g}")
        elif self.scale == "log" and self.start is not None and not self.start > 0.0:
            yield Fault(("start",), f"must be positive with scale: log, not {self.start:g}")


class FitParameters(Concept):
    """Numbers of the file that are fitted to measured curves, by `contact-locking fit`."""

    data: Annotated[
        tuple[Curve, ...],
        Field(min_length=1, max_length=_MOST),
        BeforeValidator(_curves, json_schema_input_type=str | tuple[str | Curve, ...]),
    ] = entry(..., "a CSV file, or a list of {file, set}, one for each experiment")
    quantities: dict[str, Text] = entry(
        ..., "the column of each measured quantity with the quantity, as force: reactions.top.1"
    )
    parameters: dict[str, FittedNumber] = entry(
        ..., "the numbers to fit, by their dotted keys, each with {start, bounds, scale}"
    )
    starts: Annotated[Integer, Field(ge=1, le=1000)] = entry(
        1, "how many searches, each from other numbers; the first is from those of the file"
    )

    def _faults(self) -> Iterator[Fault]:
        if not self.quantities:
            yield Fault(("quantities",), "name the columns, as force: reactions.top.1")
        if not self.parameters:
            yield Fault(("parameters",), "name the numbers to fit, as material.elasticity.young")
