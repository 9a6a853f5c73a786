"""The derivatives that a study asks for."""

from __future__ import annotations

from .base import Section, entry
from .values import Names, Switch


class SensitivityParameters(Section):
    """How quantities of the solution change with numbers of the file, by its last tangent."""

    of: Names = entry(
        ("compliance",),
        "the quantities, as contact_force.1, reactions.top.1, compliance or pressure_max",
    )
    to: Names = entry((), "the numbers, by their dotted keys, as friction.coefficient")
    check: Switch = entry(
        False, "compare with central differences, which take two more solves for each number"
    )
