"""Settings of the solver, of steps and of adapted meshes, for scripts and study files."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from contact_locking.values.concept import Concept, Fault, entry
from contact_locking.values.kinds import Count, Number, Positive, Share, StepCount, Tolerance
from contact_locking.values.value import show


def _option(value: Any) -> str | int | float | bool | None:
    if not (value is None or isinstance(value, str | int | float | bool)):
        raise ValueError(f"must be a number, text, true, false or null, not {show(value)}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"must be finite, not {show(value)}")
    return value


def _without_dash(options: dict[str, Any]) -> dict[str, Any]:
    return {key.removeprefix("-"): value for key, value in options.items()}


_Option = Annotated[bool | int | float | str | None, BeforeValidator(_option)]


def _method(value: Any) -> Any:
    return "penalty" if value == "newton" else value


_Method = Annotated[Literal["auto", "penalty", "interior_point"], BeforeValidator(_method)]


class Settings(Concept):
    """The nonlinear method, its stopping criteria and the linear solver."""

    method: _Method = entry(
        "auto", "interior_point, penalty (the method of the paper) or auto: interior_point"
    )
    tolerance: Tolerance = entry(1e-8, "relative equilibrium residual", "1")
    max_iterations: Count = entry(100, "steps of a solve or stage", "1")
    friction_tolerance: Tolerance = entry(1e-8, "relative change of the friction bound", "1")
    max_friction_updates: Count = entry(100, "updates of the friction bound", "1")
    linear: Literal["auto", "direct", "iterative"] = entry("auto", "auto, direct or iterative")
    petsc: Annotated[dict[str, _Option], AfterValidator(_without_dash)] = entry(
        {}, "further PETSc options, such as {snes_monitor: null}; they can run code and write files"
    )


_MOST_STEPS = 100_000


class Steps(Concept):
    """Times t_1 < t_2 < ..., with steps of equal length or listed."""

    to: Positive | None = entry(None, "the last time, for steps of equal length from t = 0", "time")
    count: StepCount | None = entry(None, "number of steps up to `to`", "1")
    times: Annotated[tuple[Number, ...], Field(max_length=_MOST_STEPS)] | None = entry(
        None, "the times in place of `to` and `count`, ascending", "time"
    )
    least: Positive | None = entry(
        None,
        "the shortest step: a step that does not converge is halved down to this length; "
        "null: 1/64 of the step, and 1/8 where a proof says that nothing can follow the step",
        "time",
    )
    on_failure: Literal["fail", "stop"] = entry(
        "fail",
        "where the least step fails: fail (the state that it reached, exit code 3), or stop (the "
        "last step that was solved is the result)",
    )

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


class Adaptation(Concept):
    """The loop that solves, estimates the error, marks cells and refines them."""

    tolerance: Tolerance = entry(
        0.01,
        "the relative error (certificate.errors.mesh) at which the meshes are fine enough",
        "1",
    )
    share: Share = entry(0.5, "the share of the squared error that the marked cells have", "1")
    max_dofs: Count = entry(100_000, "the most unknowns of a mesh", "1")
    max_meshes: Count = entry(12, "the most meshes, including the first", "1")
