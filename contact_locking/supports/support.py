"""A support along a direction, for scripts and study files."""

from __future__ import annotations

from typing import Any

from contact_locking.values.concept import Concept, entry, hidden
from contact_locking.values.kinds import Along, Places, TimedScalar
from contact_locking.values.value import Value


class Support(Concept):
    """``u . m = value`` on a part of the boundary, which slides freely across m.

    ``on`` are names of boundary parts; in a script also local indices of exterior facets (k,), or a
    pair of mesh tags and a value.
    """

    on: Places = entry(..., "name(s) of parts of the boundary")
    along: Along = entry(
        "normal",
        "the direction m: normal (the outward normal of the mesh), or a vector of any length",
    )
    value: TimedScalar = entry(Value.of(0.0), "the displacement along m", "length")
    at: Any = hidden("at")

    @property
    def key(self) -> str:
        """The name of the support in messages."""
        return self.at or "support"
