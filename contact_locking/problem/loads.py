"""The loads of the body, for scripts and study files.

Data are numbers, expressions of x, y, z and t, or tables; in a script also constants and functions
of DOLFINx, expressions of UFL, and functions of points (d, k) with values (k,).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeAlias

from contact_locking.supports.support import OnBoundary
from contact_locking.values.concept import ONLY, BodyKind, Concept, Fault, entry, hidden
from contact_locking.values.kinds import TimedDensity, TimedVector, TimeVector


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
