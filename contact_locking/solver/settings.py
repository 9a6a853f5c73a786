"""The settings of the solver, for scripts and study files."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator

from contact_locking.values.concept import Concept, entry
from contact_locking.values.kinds import Count, Tolerance
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
