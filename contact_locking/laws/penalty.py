"""The penalty parameters: as they are chosen, and those of the discrete problem."""

from __future__ import annotations

import math
from dataclasses import dataclass

from contact_locking.values.concept import Concept, entry
from contact_locking.values.kinds import NonNegative, PositiveOrInfinite


class PenaltyParameters(Concept):
    """n of the locking penalty R_n (23), epsilon of contact and friction (22), (25)."""

    n: PositiveOrInfinite = entry(
        math.inf, "locking penalty; .inf: the variational inequality itself", "stress"
    )
    epsilon: NonNegative | None = entry(
        None,
        "compliance of the foundation, 1/epsilon is the penalty; 0: none; null: 1/n",
        "length/stress",
    )

    @property
    def compliance(self) -> float:
        """``epsilon``, which is ``1/n`` unless it is given."""
        return 1.0 / self.n if self.epsilon is None else self.epsilon


@dataclass(frozen=True)
class Penalty:
    """``n`` penalises locking, ``epsilon`` contact; each regularisation smooths friction.

    ``n`` is a stress in (0, inf], ``epsilon >= 0`` is a length over a stress, and
    ``regularisations`` holds one length >= 0 for each contact.  An infinite n, with zero for the
    other parameters, penalises nothing: the problem is then the variational inequality itself.
    """

    n: float
    epsilon: float
    regularisations: tuple[float, ...]

    def inequality(self) -> Penalty:
        """The parameters that penalise nothing."""
        return Penalty(math.inf, 0.0, (0.0,) * len(self.regularisations))

    @property
    def is_inequality(self) -> bool:
        """Whether nothing is penalised."""
        return self == self.inequality()

    @property
    def is_strict(self) -> bool:
        """Whether no limit of the strain and no gap may be exceeded."""
        return math.isinf(self.n) and self.epsilon == 0.0

    @property
    def is_soft(self) -> bool:
        """Whether every limit of the strain and every gap may be exceeded."""
        return math.isfinite(self.n) and self.epsilon > 0.0

    @property
    def compliance(self) -> float:
        """``1/(2n)``: the strain beyond the locking limit for a unit of locking stress."""
        return 0.5 / self.n
