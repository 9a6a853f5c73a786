"""Discretisation, penalty, solver, certificate and output."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, field_validator, model_validator

from .base import Fault, Section, entry, refuse_if
from .probes import MOST_POINTS, Probe
from .values import Count, Degree, Positive, PositiveOrInfinite, Switch, Text, Tolerance
from .wording import show

# Linux's PATH_MAX is 4096, and the names of the files are appended to the folder.
_LONGEST_PATH = 3900


class DiscretisationParameters(Section):
    """The element: the degree of the displacements, and the points where the strain keeps M."""

    degree: Degree = entry(
        1, "degree of the displacements in each cell: 1, as in the theorems of the paper, or 2", "1"
    )
    limit_at: Literal["vertices", "gauss"] | None = entry(
        None,
        "where the strain of degree 2 keeps the limit: vertices of each cell, hence everywhere, or "
        "gauss, which is closer to the solution and exceeds M between the points; null: vertices, "
        "and gauss for an axisymmetric body; for degree 1 both are the same",
        optional=True,
    )


class PenaltyParameters(Section):
    """n of the locking penalty R_n (23), epsilon of contact and friction (22), (25)."""

    n: PositiveOrInfinite = entry(
        math.inf, "locking penalty; .inf: the variational inequality itself", "stress"
    )
    epsilon: Positive | None = entry(
        None, "compliance of the foundation, 1/epsilon is the penalty; null: 1/n", "length/stress"
    )

    @property
    def compliance(self) -> float:
        """``epsilon``, which is ``1/n`` unless it is given."""
        return 1.0 / self.n if self.epsilon is None else self.epsilon


def _option(value: Any) -> str | int | float | bool | None:
    if not (value is None or isinstance(value, str | int | float | bool)):
        raise ValueError(f"must be a number, text, true, false or null, not {show(value)}")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError(f"must be finite, not {show(value)}")
    return value


Option = Annotated[bool | int | float | str | None, BeforeValidator(_option)]


class SolverParameters(Section):
    """The nonlinear method, its stopping criteria and the linear solver."""

    method: Literal["auto", "newton", "interior_point"] = entry(
        "auto", "interior_point, newton (with continuation in n) or auto: interior_point"
    )
    friction: Literal["inside", "nested"] = entry(
        "inside",
        "interior_point: update the friction bound inside the iteration, or nested around whole "
        "solves, which shows the contraction factor of the fixed point; newton always nests",
    )
    tolerance: Tolerance = entry(1e-8, "relative equilibrium residual", "1")
    max_iterations: Count = entry(100, "steps of a solve or stage", "1")
    friction_tolerance: Tolerance = entry(1e-8, "relative change of the friction bound", "1")
    max_friction_updates: Count = entry(100, "updates of the friction bound", "1")
    linear: Literal["auto", "direct", "iterative"] = entry("auto", "auto, direct or iterative")
    petsc: dict[str, Option] = entry(
        {},
        "further PETSc options, such as {snes_monitor: null}; none that runs code or names files",
    )

    @field_validator("petsc")
    @classmethod
    def _without_dash(cls, options: dict[str, Any]) -> dict[str, Any]:
        return {key.removeprefix("-"): value for key, value in options.items()}


class CertificateParameters(Section):
    """Checks of the results that cost extra solves, in addition to those of every run."""

    constants: Switch = entry(
        False, "c_0 by an eigenvalue problem, and whether theory excludes a second solution"
    )
    limit: Switch = entry(
        False, "solve for n = .inf on the same mesh too, and measure the distance to its solution"
    )
    error_bound: Switch = entry(
        False,
        "a proved bound of the error of mesh and penalty in the energy norm, for the friction "
        "bound of the solution; in 2D",
    )


class OutputParameters(Section):
    """The files with the results."""

    directory: Text = entry("results", "folder of the results")
    fields: Switch = entry(True, "whether to write the fields for ParaView")
    formats: tuple[Literal["vtx", "xdmf"], ...] = entry(
        ("vtx",),
        "the files of the fields: vtx (fields.bp, for ParaView 5.11 or newer, or 5.12 for more "
        "than 0.5 GB), xdmf (fields.xdmf, for tools that do not read VTX), or both",
    )
    picture: Switch = entry(
        True, "whether to draw a picture, and save the snapshot that `view` shows"
    )
    animation: Switch = entry(
        True,
        "whether a process with a picture has an animation, animation.gif, of at most 40 frames",
    )
    probes: tuple[Probe, ...] = entry(
        (), "points where probes.csv has displacement, strain norm and stresses"
    )

    @model_validator(mode="after")
    def _not_too_many_points(self) -> OutputParameters:
        count = sum(probe.count for probe in self.probes)
        if count > MOST_POINTS:
            refuse_if([Fault(("probes",), f"{count} points; at most {MOST_POINTS}")])
        return self

    @field_validator("directory")
    @classmethod
    def _some_folder(cls, directory: str) -> str:
        if not directory.strip() or "\0" in directory:
            raise ValueError("must name a folder")
        if len(directory.encode()) > _LONGEST_PATH:
            raise ValueError(f"must have at most {_LONGEST_PATH} bytes")
        return directory

    def dimension_faults(self, dim: int) -> Iterator[Fault]:
        """The points of probes that do not have ``dim`` coordinates."""
        for index, probe in enumerate(self.probes):
            for fault in probe.dimension_faults(dim):
                yield Fault(("probes", index, *fault.place), fault.message)
