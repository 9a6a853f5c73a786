"""The parts of a certificate that are made on demand."""

from __future__ import annotations

from contact_locking.values.concept import Concept, entry
from contact_locking.values.kinds import Switch


class Extras(Concept):
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
    critical_friction: Switch = entry(
        False,
        "the least multiple of the friction coefficient at which the linearised problem at the "
        "solution is singular, by the eigenvalues on Gamma_C",
    )


USUAL = Extras()
