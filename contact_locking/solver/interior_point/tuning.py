"""The tuning constants of the interior point method, in one place."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Approach:
    """One way to run the method.

    ``opening`` is the least opening of contact at the start, relative to the strain times the
    length.  ``trusts_newton`` lets the predictor foresee the step of the friction bound, and leaves
    the bound where a step brought it, if that is closer to ``mu |R p|``, to which it is set after
    each step otherwise.
    """

    opening: float
    trusts_newton: bool


#: Faster on fine meshes.
CLOSE = Approach(0.1, trusts_newton=True)
#: Finds solutions where friction changes much with the slip.
WIDE = Approach(100.0, trusts_newton=False)


@dataclass(frozen=True)
class Tuning:
    """The constants of the method, measured to be fast, in the order of the algorithm."""

    # The start.
    #: The complementarity products at the start over the density of the elastic energy.
    start_level: float = 0.03
    #: Where springs stand for contact the products start at the elastic stress times the limits of
    #: the strain at least.  Limits beyond the strain by more than the reciprocal of this number
    #: count as so far: there few cells lock.
    least_overstrain: float = 0.01
    #: The share of the loads' displacement that the start keeps, so that few cells are far beyond
    #: their limit.
    start_load: float = 0.001
    #: The residual of the elastic solve over the forces while nobody knows whether its displacement
    #: is admissible.
    start_accuracy: float = 0.03
    #: Where the elastic strain over its limit is between these two numbers, contact starts with the
    #: opening :attr:`wide_opening`.  That takes up to a third fewer tangents there, but more
    #: tangents where hardly any cell locks or nearly every cell does.  Over the factor
    #: :attr:`wide_ramp` outside of them the opening passes from one to the other: where a limit is
    #: as large as a prescribed strain, rounding must not decide about the start.
    wide_between: tuple[float, float] = (1.25, 6.4)
    wide_ramp: float = 1.25
    wide_opening: float = 1.0
    #: An elastic displacement that exceeds its limits by this share at most is computed sharply
    #: before it is judged, to the residual of the second number over the tolerance.
    start_margin: float = 0.1
    start_sharpness: float = 0.3
    #: The least friction bound over the largest, so that the friction cones have an inside.
    least_bound: float = 1e-12

    # The linear solves.
    #: The residual that a linear solve may leave over the duality gap.  Sharper solves save a
    #: tangent or two and cost more than these.
    linear_share: float = 0.6
    #: The sharpest residual that a linear solve is asked for over the tolerance.
    linear_sharpest: float = 0.03
    #: Where the gap is below its tolerance, the friction bounds are not, and a step has not brought
    #: them closer, linear solves are sharper by this factor from then on.
    linear_sharper: float = 0.1
    #: The largest residual that a linear solve may leave over the forces.  At the beginning the
    #: equilibrium residual is a hundred times as large as the forces; solves that left more led to
    #: short steps, at n = inf to five tangents more or nowhere.
    linear_loosest: float = 0.03
    #: Cells and nodes that are stiffer than the material by this factor go into the filter of the
    #: multigrid.
    stiff: float = 10.0
    #: A new filter takes along what is stiffer by this factor, as most of it gets stiff later.
    nearly_stiff: float = 0.5
    #: Points that are stiffer than the material along one strain or one displacement by this factor
    #: are projected where more is stiff than the filter takes.  Each has a row in the matrix that
    #: is factorised for it; below, multigrid does with the contrast.
    stiff_along: float = 300.0
    #: The same for quadratic elements, for which multigrid bears less contrast.
    stiff_along_quadratic: float = 10.0

    # Predictor and corrector.
    #: A predictor that goes this far is trusted with Mehrotra's second-order terms in full; shorter
    #: ones in proportion, as terms of a direction that leads nowhere mislead.
    trusted_length: float = 1.0 / 3.0
    #: With an iterative solver the products to aim at follow from the predictor's length in all
    #: cones but for this share.  At the edge of the contact the directions of locking stresses
    #: turn, and a few cells end the predictor at once.
    left_behind: float = 1e-4
    #: After a step of this length the products aimed at are smaller by the factor :attr:`bolder`:
    #: what makes predictors short does not always make steps short.
    bolder_after: float = 0.85
    bolder: float = 0.3
    #: The products aimed at may grow by this factor where the duality gap is below its tolerance.
    gap_growth: float = 10.0
    #: The share of the gap's tolerance that is aimed at.
    gap_aim: float = 0.5
    #: A duality gap that is a smaller share than this of the equilibrium residual is kept: products
    #: that are much smaller than the residuals block every step.
    gap_ahead: float = 1e-2

    # The friction bound.
    #: The relative residual of the linear system for the step of the bound.  A smaller one saves no
    #: tangents.
    bound_rtol: float = 1e-2
    #: Steps of the bound contract if the first iteration leaves this share of the residual at most.
    bound_contracts: float = 0.2
    #: Where they contract and the duality gap is above this, the predictor foresees the step of the
    #: bound.
    foreseen_above: float = 1e-5
    #: The residual that is then enough, relative to the step foreseen: what is left shrinks by
    #: itself in the next steps.
    bound_rtol_foreseen: float = 0.1
    #: The most iterations for that step.
    bound_iterations: int = 30
    #: A step takes away this share of the bound at most, so that it stays positive.
    bound_most_taken: float = 0.95
    #: A step has brought the bound closer to ``mu |R p|`` if it leaves this share of the distance.
    bound_closer: float = 0.5
    #: A distance of this share of the bound is close however it changed, unless the step was
    #: shorter than :attr:`bound_led`: such steps would keep the distance for ever.
    bound_close: float = 1e-6
    bound_led: float = 0.1

    # Recentring, by Gondzio's correctors.
    #: The most recentrings for each tangent, and the length of steps that need none.
    recentrings: int = 3
    long_enough: float = 0.95
    #: How much farther than the present step a recentring looks.
    reach: float = 0.4
    #: Where less of a recentring makes the step longer, so much of it is taken.  In full it may
    #: miss its aim where the products are far outside of their band.
    recentring_shares: tuple[float, ...] = (0.75, 0.5, 0.3, 0.15)
    #: A recentring that makes the step longer by this factor is kept, else it is the last.
    gain: float = 1.01
    #: Products between these multiples of the target are left alone.
    band: tuple[float, float] = (0.1, 10.0)
    #: Recentrings keep the step of the friction bound, unless that then misses what agrees with
    #: them by more than this share of the bound, as happens where friction is large.
    bound_missed: float = 0.03

    # The step.
    #: How far a step goes towards the boundary of the cones.
    to_boundary: float = 0.97
    #: Steps that are shorter lead nowhere, and the method gives up.
    shortest: float = 1e-8
    #: Where friction bounds move, more steps in a row than this number that are shorter than this
    #: length lead nowhere either.  Solves that arrive take fewer.
    short_steps: int = 9
    short: float = 0.01

    #: A solve whose worst measure has not fallen to the first of these numbers times the best in so
    #: many iterations arrives nowhere; of penalised locking and contact, which always have a
    #: solution under a known bound, in so many.
    nearer: float = 0.7
    patience: int = 18
    patience_with_penalties: int = 40

    # The stopping rule.
    #: The duality gap over the energy at which the method stops.  Rounding in nearly singular cones
    #: leaves about 1e-9.
    gap_tolerance: float = 1e-8
    #: A gap that rounding in the cones excuses is rough above so many times the tolerance.
    gap_left: float = 10.0
    #: Where the pieces do not finish the solution of a penalised problem, a locking stress
    #: may differ by this share of the largest from that of its law at the displacement.
    off_law: float = 3e-7
    #: There the method aims at this share of the gap's tolerance, and takes so many more steps at
    #: most, as points where stress and room vanish together arrive slowly.
    gap_aim_of_law: float = 1e-4
    steps_for_law: int = 4
    #: For n over the stiffness of the material beyond this, rounding in strains is in the way.
    stiffest_law: float = 1e7
    #: These shares of the work of locking and of the elastic energy at the start stand for the
    #: energy if that is smaller.
    locking_share: float = 1e-2
    least_energy: float = 1e-18
    #: Forces that are unbalanced by more than this multiple of what a step should have left are
    #: those of rounding, where the linear solver is direct.  So is a tangent that is singular.
    rounded: float = 10.0
    #: Steps are then no stiffer than the material by the second of these factors, and where that
    #: does not help by a tenth of it, and so on to the first.  Softer steps take more tangents.
    stiffest: tuple[float, float] = (1e7, 1e11)
    #: Multipliers that have grown by this factor, while the residual of the laws is at least this
    #: share of the first, may prove that no displacement is admissible.
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
