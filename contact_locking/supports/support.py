"""Supports, prescribed displacements, springs and loads, for scripts and study files.

Data of loads are numbers, expressions of x, y, z and t, or tables; in a script also constants and
functions of DOLFINx, expressions of UFL, and functions of points (d, k) with values (k,).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, TypeAlias

from pydantic import BeforeValidator

from contact_locking.values.concept import ONLY, PER_AXIS, BodyKind, Concept, Fault, entry, hidden
from contact_locking.values.kinds import (
    Along,
    Places,
    PositiveScalar,
    TimedDensity,
    TimedScalar,
    TimedVector,
    TimeVector,
    components,
)
from contact_locking.values.value import Value

#: Advice for a part with contact that is to be held along its surface.
HOLD_ALONG = (
    "null across it, as in [0, null], holds it along its surface, as do stiff loads.springs with "
    "along: a tangent"
)


class OnBoundary(Concept):
    """A condition or a load on a part of the boundary.

    ``on`` are names of boundary parts; in a script also local indices of exterior facets (k,), or a
    pair of mesh tags and a value.
    """

    on: Places = entry(..., "name(s) of parts of the boundary")
    at: Any = hidden("at")

    @property
    def key(self) -> str:
        """Its key in messages."""
        return self.at or type(self).__name__.lower()


class Support(OnBoundary):
    """``u . m = value`` on a part of the boundary, which slides freely across m."""

    along: Along = entry(
        "normal",
        "the direction m: normal (the outward normal of the mesh), or a vector of any length",
    )
    value: TimedScalar = entry(Value.of(0.0), "the displacement along m", "length")


class Displacement(OnBoundary):
    """u = value on a part of the boundary; a null component stays free."""

    value: Annotated[tuple[TimedScalar | None, ...], BeforeValidator(components), PER_AXIS] = entry(
        ..., "components of u; null leaves one free", "length"
    )

    def _faults(self) -> Iterator[Fault]:
        if all(component is None for component in self.value):
            yield Fault(("value",), "fixes no component; give a number for at least one")


class Spring(OnBoundary):
    """sigma nu = -k (u . m) m on a part of the boundary: an elastic foundation, or a spring bed."""

    stiffness: PositiveScalar = entry(..., "k > 0", "stress/length")
    along: Along | None = entry(
        None, "the direction m: normal, or a vector of any length; null: springs in all directions"
    )


class BodyForce(Concept):
    """-div sigma = f0 in the whole body."""

    value: TimedVector = entry(..., "components of f0", "force/volume", alias=ONLY)
    at: str | None = hidden("at")

    @property
    def key(self) -> str:
        """Its key in messages."""
        return self.at or "bodyforce"


class Traction(OnBoundary):
    """sigma nu = g on a part of the boundary."""

    value: TimedVector = entry(..., "components of g", "stress")


class Pressure(OnBoundary):
    """sigma nu = -p nu on a part of the boundary, with the outward normal nu of the mesh."""

    value: TimedDensity = entry(
        ...,
        "pressure p along the normal: a positive p pushes on the body, a negative p pulls",
        "stress",
    )


class TotalForce(OnBoundary):
    """``int sigma nu = F`` on a part of the boundary, spread evenly: ``sigma nu = F/|part|``.

    The parts in ``on`` share the force by their sizes.
    """

    value: TimeVector = entry(..., "components of F; in 2D for a unit of thickness", "force")

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.axisymmetric and self.value[0] != 0.0:
            yield Fault(
                ("value", 0),
                "must be 0: the total force on a body of revolution acts along the axis; give "
                "what acts along the radius as pressures or tractions",
            )


Load: TypeAlias = BodyForce | Traction | Pressure | TotalForce
