"""The element, and what takes a wing: other solutions, branches and derivatives."""

from __future__ import annotations

from contact_locking.values.concept import Concept, entry
from contact_locking.values.kinds import Count, Degree, Names, Positive, Switch, Text


class DiscretisationParameters(Concept):
    """The element: the degree of the displacements."""

    degree: Degree = entry(
        1, "degree of the displacements in each cell: 1, as in the theorems of the paper, or 2", "1"
    )


class EquilibriaParameters(Concept):
    """Several solutions of one problem with friction."""

    find: Count = entry(
        5,
        "the most solutions, with the first; those beside it are in folders equilibrium_2, ...",
        "1",
    )


class BranchesParameters(Concept):
    """A branch of solutions over a share of the friction coefficient or of loads.

    Over the friction coefficient it begins with none of it, over loads with those of the file.
    """

    over: Text = entry(
        "friction.coefficient",
        "what the branch multiplies by a share: friction.coefficient, loads (all of them, with "
        "prescribed displacements), or the key of some of them, such as loads.tractions.0.value",
    )
    to: Positive = entry(2.0, "the last share", "1")

    @property
    def is_over_friction(self) -> bool:
        return self.over == "friction.coefficient"


class SensitivityParameters(Concept):
    """How quantities of the solution change with numbers of the file, by its last tangent."""

    of: Names = entry(
        ("compliance",),
        "the quantities, as contact_force.1, reactions.top.1, compliance or pressure_max",
    )
    to: Names = entry((), "the numbers, by their dotted keys, as friction.coefficient")
    check: Switch = entry(
        False, "compare with central differences, which take two more solves for each number"
    )
