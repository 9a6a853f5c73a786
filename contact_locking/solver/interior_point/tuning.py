"""The tuning constants of the interior point method, in one place."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Approach:
    """One way to run the method.

    - ``opening``: the least opening of contact at the start, over the strain times the length
    - ``trusts_newton``: whether the predictor includes the step of the friction bound, and the
      bound stays where a step brought it if that is closer to ``mu |R p|``; if not it is set to
      ``mu |R p|`` after each step
    """

    opening: float
    trusts_newton: bool


#: The faster one on fine meshes.
CLOSE = Approach(0.1, trusts_newton=True)
#: The more robust one if friction depends strongly on the slip.
WIDE = Approach(100.0, trusts_newton=False)


@dataclass(frozen=True)
class Tuning:
    """The constants of the method in the order of the algorithm, chosen by measurements."""

    # The start.
    #: The complementarity products at the start over the density of the elastic energy.
    start_level: float = 0.03
    #: With springs for contact the products start at least at the elastic stress times the strain
    #: limits.  The strain over its limit counts as at least this: below, few cells lock.
    least_overstrain: float = 0.01
    #: The share of the loads' displacement that the start keeps, so that few cells are far beyond
    #: their limit.
    start_load: float = 0.001
    #: The residual of the first elastic solve over the forces.
    start_accuracy: float = 0.03
    #: If the elastic strain over its limit is between these two numbers, contact starts with the
    #: opening :attr:`wide_opening`, which takes up to a third fewer tangents.  It takes more if
    #: hardly any cell locks or nearly all do.  Outside, the opening changes continuously over the
    #: factor :attr:`wide_ramp`, so that rounding does not decide if a limit equals a prescribed
    #: strain.
    wide_between: tuple[float, float] = (1.25, 6.4)
    wide_ramp: float = 1.25
    wide_opening: float = 1.0
    #: An elastic displacement that exceeds its limits by at most this share is first refined, to a
    #: residual of the second number times the tolerance.
    start_margin: float = 0.1
    start_sharpness: float = 0.3
    #: The least friction bound over the largest, so that the friction cones have an inside.
    least_bound: float = 1e-12

    # The linear solves.
    #: The residual of a linear solve over the duality gap.  Sharper solves save a tangent or two
    #: and cost more than these.
    linear_share: float = 0.6
    #: The least residual of a linear solve over the tolerance.
    linear_sharpest: float = 0.03
    #: The factor by which linear solves get sharper if the gap is below its tolerance, the friction
    #: bounds are not, and a step has not brought them closer.
    linear_sharper: float = 0.1
    #: The largest residual of a linear solve over the forces.  At first the equilibrium residual is
    #: a hundred times the forces; with a larger number steps were short, and at n = inf it took
    #: five tangents more or failed.
    linear_loosest: float = 0.03
    #: Cells and nodes that are stiffer than the material by this factor go into the filter of the
    #: multigrid.
    stiff: float = 10.0
    #: A new filter also includes what is stiffer by this factor, most of which gets stiff later.
    nearly_stiff: float = 0.5
    #: If too much is stiff for the filter, points that are stiffer than the material along one
    #: strain or displacement by this factor are projected.  Each is a row of a matrix that is
    #: factorised; multigrid tolerates a smaller contrast.
    stiff_along: float = 300.0
    #: The same for quadratic elements, for which multigrid tolerates less contrast.
    stiff_along_quadratic: float = 10.0

    # Predictor and corrector.
    #: If the predictor reaches this length, Mehrotra's second-order terms are used in full; for a
    #: shorter one in proportion, because then they mislead.
    trusted_length: float = 1.0 / 3.0
    #: With an iterative solver the target follows from the predictor's length in all cones except
    #: this share: at the edge of the contact locking stresses turn, and a few cells would make the
    #: predictor very short.
    left_behind: float = 1e-4
    #: After a step of this length the target is smaller by the factor :attr:`bolder`, because short
    #: predictors do not always mean short steps.
    bolder_after: float = 0.85
    bolder: float = 0.3
    #: The products may grow by this factor if the duality gap is below its tolerance.
    gap_growth: float = 10.0
    #: The gap to aim at, over its tolerance.
    gap_aim: float = 0.5
    #: A duality gap below this share of the equilibrium residual is kept: products much smaller
    #: than the residuals block every step.
    gap_ahead: float = 1e-2

    # The friction bound.
    #: The relative residual of the linear system for the step of the bound.  A smaller one saves no
    #: tangents.
    bound_rtol: float = 1e-2
    #: The map of bounds contracts if one iteration reduces the residual to this share.
    bound_contracts: float = 0.2
    #: If it contracts and the duality gap is above this, the predictor includes the step of the
    #: bound.
    predicted_above: float = 1e-5
    #: The residual that then suffices, relative to the predicted step: the following steps reduce
    #: it anyway.
    bound_rtol_predicted: float = 0.1
    #: The most iterations for that step.
    bound_iterations: int = 30
    #: A step reduces the bound by at most this share, so that it stays positive.
    bound_most_taken: float = 0.95
    #: A step has brought the bound closer to ``mu |R p|`` if at most this share of the distance is
    #: left.
    bound_closer: float = 0.5
    #: A distance below this share of the bound counts as close in any case, except after steps
    #: shorter than :attr:`bound_led`, which would never reduce it.
    bound_close: float = 1e-6
    bound_led: float = 0.1

    # Recentring, by Gondzio's correctors.
    #: The most recentrings for each tangent, and the length of steps that need none.
    recentrings: int = 3
    long_enough: float = 0.95
    #: How much farther than the present step a recentring looks.
    reach: float = 0.4
    #: Shares of a recentring that are tried, too: in full it may overshoot if products are far
    #: outside of their band.
    recentring_shares: tuple[float, ...] = (0.75, 0.5, 0.3, 0.15)
    #: A recentring is kept if it makes the step longer by this factor; otherwise it is the last.
    gain: float = 1.01
    #: Products between these multiples of the target are not corrected.
    band: tuple[float, float] = (0.1, 10.0)
    #: The step of the friction bound is computed anew after recentrings if it is off by more than
    #: this share of the bound, as with large friction.
    bound_missed: float = 0.03

    # The step.
    #: The length of a step over that to the boundary of the cones.
    to_boundary: float = 0.97
    #: The method gives up after a shorter step.
    shortest: float = 1e-8
    #: With moving friction bounds it also gives up after more than this number of steps in a row
    #: that are shorter than this length; solves that converge take fewer.
    short_steps: int = 9
    short: float = 0.01

    #: It gives up if the worst measure has not fallen to the first number times its best within
    #: ``patience`` iterations, or within the last number if locking and contact are penalised,
    #: which have a solution under every known bound.
    nearer: float = 0.7
    patience: int = 18
    patience_with_penalties: int = 40

    # The stopping rule.
    #: The duality gap over the energy at which the method stops.  Rounding in nearly singular cones
    #: leaves about 1e-9.
    gap_tolerance: float = 1e-8
    #: A gap that is accepted because of rounding counts as large above this multiple of the
    #: tolerance.
    large_gap: float = 10.0
    #: If the pieces cannot finish a penalised solution, a locking stress may differ from its law at
    #: the displacement by this share of the largest.
    off_law: float = 3e-7
    #: For that the method aims at this share of the gap's tolerance, in at most so many extra
    #: steps: points where stress and distance to the limit are both zero converge slowly.
    gap_aim_of_law: float = 1e-4
    steps_for_law: int = 4
    #: For a larger n over the stiffness of the material rounding in strains exceeds that.
    stiffest_law: float = 1e7
    #: The least energy that the gap is relative to: these shares of the work of locking, and of the
    #: elastic energy at the start.
    locking_share: float = 1e-2
    least_energy: float = 1e-18
    #: A proof of infeasibility is tried if multipliers have grown by the first factor while the
    #: residual of the laws is at least the second share of its first value.
    diverged: float = 1e2
    violated: float = 0.01

    def opening(self, approach: Approach, overstrain: float) -> float:
        """The least opening of contact at the start; ``overstrain`` is the strain over its limit.

        A geometric mean of the opening of ``approach`` and the wide one, continuous in the strain.
        """
        low, high = self.wide_between
        beyond = max(low / overstrain, overstrain / high, 1.0) if overstrain > 0.0 else math.inf
        share = max(0.0, 1.0 - math.log(beyond) / math.log(self.wide_ramp))
        wide = max(approach.opening, self.wide_opening)
        return approach.opening * (wide / approach.opening) ** share
