"""The penalty parameters to solve for, and the scales of the problem."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from contact_locking.laws.penalty import Penalty
from contact_locking.problem.rounding import ROUNDING


@dataclass(frozen=True)
class Target:
    """The penalty parameters, and the scales of the problem that starting values are made from.

    ``stiffness`` and ``ellipticity`` are the largest and the smallest eigenvalue of A,
    ``young`` its Young's modulus, ``length`` the extent of the body, ``volume`` its measure and
    ``face`` the measure of a face as long as the body.
    """

    penalty: Penalty
    stiffness: float
    ellipticity: float
    young: float
    length: float
    volume: float
    face: float

    def with_penalty(self, penalty: Penalty) -> Target:
        """The same problem with other penalty parameters."""
        return dataclasses.replace(self, penalty=penalty)

    @property
    def largest_contrast(self) -> float:
        """``n/|A|``: about how many times stiffer than the material locked cells can become."""
        return self.penalty.n / self.stiffness

    def mean_strain(self, energy: float, displacement: float, tolerance: float) -> float:
        """``sqrt(a(u, u)/(alpha |Omega|))``, or what rounding in ``u`` leaves, if that is larger.

        ``energy`` is ``a(u, u)/2`` and ``displacement`` the largest ``|u|``.  Strains that are this
        number times ``tolerance`` are told from zero, smaller ones are not.
        """
        mean = math.sqrt(2.0 * max(energy, 0.0) / (self.ellipticity * self.volume))
        return max(mean, ROUNDING * displacement / (self.length * tolerance))

    def least_bound(self, mean_strain: float) -> float:
        """The L2 norm on Gamma_C below which changes of the friction bound are judged absolutely.

        It is a thousandth of the stress of :meth:`mean_strain` over a face of the body: where
        contact only grazes, relative changes of next to nothing say nothing, and where the strain
        itself is next to nothing beside the displacement, they are rounding.
        """
        stress = math.sqrt(self.stiffness * self.ellipticity) * mean_strain
        return 1e-3 * stress * math.sqrt(self.face)
