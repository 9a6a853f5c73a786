"""The derivative of the last iterate: a tangent with its cones, and the friction bounds around it.

With the Nesterov-Todd scaled tangent ``K`` of the last iterate, data that leave forces r, gaps g of
the points and e of the bounds move it by

    K du + sum lin^T (c(g) + rho b) = -r,      b - mu R dp - mu'(s) |R p| ds = e,

where ``c`` and ``rho b`` are the reactions to gaps and bounds if nothing moves, and pressure and
slip follow ``du`` and ``g``.  The adjoint of this for a quantity J is

    K l = J_u + sum lin^T D J_r + P^T y,       y = rho^T (J_r - lin l),

with ``P du`` what the bounds follow a displacement by, and the same K, which is symmetric.  Both
are solved for the bounds, whose system is small beside K, by generalised conjugate residuals.

A solve ends where residuals and the duality gap are small.  The complementarity products of its
cones may then be a hundred times apart.  Off the path ``x o z = theta e`` with one theta, a point
near a change of its state has a derivative that belongs to another theta than that of its
neighbours, and was up to 40 % off.  On the path an iterate is a smooth function of the data.

The penalty laws are limits of central paths: with the product theta of a point and its multiplier,
``x o z = theta e`` and the compliances give a smooth law for each displacement, which differs from
the penalty law by a share of theta except at a kink.  So one tangent serves both methods.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.errors import NotConverged
from contact_locking.inverse.equations import Equations, Residual
from contact_locking.parallel import maximum, minimum
from contact_locking.problem.system import System
from contact_locking.solver.interior_point.bound_step import BoundLaw
from contact_locking.solver.interior_point.cones import Step
from contact_locking.solver.interior_point.contact_cones import ContactCones, FrictionCones
from contact_locking.solver.interior_point.family import Family, Reactions
from contact_locking.solver.interior_point.iterate import families_of
from contact_locking.solver.interior_point.lorentz import dot
from contact_locking.solver.interior_point.tangent import Tangent
from contact_locking.solver.interior_point.tuning import Tuning
from contact_locking.solver.ksp import factorise
from contact_locking.solver.task import SavedState, Target, Task

# The residual of the system of the bounds, relative, and the most iterations for it.
_BOUNDS, _MOST = 1e-9, 300
# The residual that an iterative solver leaves of each right-hand side, relative.
_ITERATIVE = 1e-9
# A solution is refined until a correction is this share of it, or so often.
_REFINED, _REFINEMENTS = 1e-13, 5


@dataclass(frozen=True)
class Gradient:
    """The derivatives of a quantity: by displacement and travels, and by reactions of families.

    ``displacement`` has owned values, with the travels behind them.  ``reactions`` has arrays in
    the shape of what a family sees, which ``int`` pairs with the change of its reactions.
    """

    displacement: FloatArray
    reactions: Mapping[Family, FloatArray]


@dataclass(frozen=True)
class Change:
    """How an iterate moves: displacement with travels behind it, and the steps of its families."""

    displacement: FloatArray
    steps: Mapping[Family, Step]
    reactions: Mapping[Family, FloatArray]


@dataclass(frozen=True)
class _Answer:
    """A displacement with travels behind it, what each family sees of it, and the reactions.

    Both are summed over refinements: of the sums before them, the rounding would count, times the
    stiffness of the cones.
    """

    displacement: FloatArray
    seen: Mapping[Family, FloatArray]
    reactions: Mapping[Family, FloatArray]

    def plus(self, other: _Answer, share: float = 1.0) -> _Answer:
        """The answer plus a share of another one."""
        seen, reactions = (
            {family: values + share * added[family] for family, values in mine.items()}
            for mine, added in ((self.seen, other.seen), (self.reactions, other.reactions))
        )
        return _Answer(self.displacement + share * other.displacement, seen, reactions)


@dataclass(frozen=True)
class Adjoint:
    """The gain of a quantity by residuals: by forces, by gaps of each family and by each bound.

    ``displacement`` is l, the displacement of the adjoint, with travels behind it.  Arrays of gaps
    and bounds are per weight.
    """

    displacement: FloatArray
    gaps: Mapping[Family, FloatArray]
    bounds: tuple[FloatArray, ...]


def _joined(parts: Iterable[FloatArray]) -> FloatArray:
    return np.concatenate([np.empty(0), *parts])


class Linearisation:
    """Derivatives at the iterate of ``equations``; the tangent is factorised once.

    ``solves`` counts the solves with it.  The constructor is collective, as all methods are.
    """

    def __init__(self, equations: Equations, task: Task) -> None:
        self.equations, self.solves = equations, 0
        self._comm, self._owned = equations.system.comm, len(equations.system.load)
        self.tangent = Tangent(task, equations.every, Tuning())
        for bound in equations.bounds:
            bound.friction.growth = np.maximum(bound.slope(), 0.0)
        for family in equations.every:
            if family.takes_part:
                family.linearise()
            else:
                family.hold(0.0)
        self.tangent.refresh()
        if self.tangent.direct is not None:
            factorise(self.tangent.direct)
        self._laws = [BoundLaw(bound, 1.0) for bound in equations.bounds]
        self._pressing = [bound.pressing for bound in equations.bounds]
        self._weights = _joined(law.friction.weights for law in self._laws)
        self._ends = np.cumsum([len(law.friction.weights) for law in self._laws])[:-1]

    # Forward.

    def change(self, residual: Residual) -> Change:
        """How the iterate moves with data that change what the equations leave by ``residual``."""
        self._still()
        for family, gap in zip(self.equations.families, residual.gaps, strict=True):
            family.move(gap)
        reactions = {
            family: family.reactions_of(family.step(np.zeros_like(family.seen)).dual)
            for family in self.equations.families
        }
        return self._moved(residual, reactions)

    def centring(self, product: float) -> Change:
        """The step to products that are ``product`` in all cones and equations that hold.

        Comes before all other changes, which move the families; collective.
        """
        self._still()
        reactions = {f: f.aim(product) - f.reactions for f in self.equations.families}
        return self._moved(self.equations.residual(), reactions)

    def _moved(self, residual: Residual, reactions: Reactions) -> Change:
        """The change by a residual, with the ``reactions`` if nothing moves."""
        solution = self._solve(-residual.free, reactions)
        steps = self._steps(solution)
        moved = [
            law.moved(solution.reactions[pressing], law.friction.slip_step(steps[law.friction]))
            for law, pressing in zip(self._laws, self._pressing, strict=True)
        ]

        def responses(bounds: FloatArray) -> Reactions:
            parts = self._parts(bounds)
            return {law.friction: law.friction.response(step) for law, _, step in parts}

        def followed(answer: _Answer) -> FloatArray:
            """Less the change of the bounds by a response of the displacement."""
            return -_joined(
                law.moved(answer.reactions[pressing], answer.seen[law.friction])
                for law, pressing in zip(self._laws, self._pressing, strict=True)
            )

        right = _joined(residual.bounds) + _joined(moved)
        bounds, correction = self._krylov(responses, followed, right)
        solution = solution.plus(correction)
        for law, _, change in self._parts(bounds):
            law.friction.bound_step = change
        return Change(solution.displacement, self._steps(solution), solution.reactions)

    def _steps(self, answer: _Answer) -> dict[Family, Step]:
        return {family: family.step(answer.seen[family]) for family in self.equations.families}

    def _parts(self, bounds: FloatArray) -> list[tuple[BoundLaw, ContactCones, FloatArray]]:
        """Each law with the cones that press, and its part of all bounds."""
        parts = np.split(bounds, self._ends)[: len(self._laws)]
        return list(zip(self._laws, self._pressing, parts, strict=True))

    def _still(self) -> None:
        for law in self._laws:
            law.friction.bound_step = np.zeros(len(law.friction.weights))

    # Adjoint.

    def adjoint(self, gradient: Gradient) -> Adjoint:
        """The gain by residuals of the quantity with this gradient."""
        pulls = gradient.reactions
        pulled = {family: -family.block(values) for family, values in pulls.items()}
        total = self._solve(gradient.displacement, pulled)
        frictions = [law.friction for law in self._laws]
        right = _joined(f.response_adjoint(pulls.get(f, np.zeros_like(f.seen))) for f in frictions)

        def seen(answer: _Answer) -> FloatArray:
            return _joined(f.response_adjoint(answer.seen[f]) for f in frictions)

        def pulled_by(bounds: FloatArray) -> Reactions:
            """Less ``P^T y``: what bounds follow a displacement by."""
            reactions: dict[Family, FloatArray] = {}
            for law, pressing, bound in self._parts(bounds):
                pressure, slip = law.moved_adjoint(bound)
                reactions[pressing] = -pressing.stiffness * pressure
                reactions[law.friction] = -slip
            return reactions

        bounds, correction = self._krylov(pulled_by, seen, right - seen(total))
        total, parts = total.plus(correction), self._parts(bounds)
        gaps = {
            f: f.move_adjoint(pulls.get(f, 0.0) - total.seen[f], -total.reactions[f])
            for f in self.equations.families
        }
        for law, _, bound in parts:
            slip = law.moved_adjoint(bound)[1]
            gaps[law.friction][1 : 1 + len(slip)] += slip
        return Adjoint(total.displacement, gaps, tuple(bound for _, _, bound in parts))

    def gained(self, adjoint: Adjoint, residual: Residual) -> float:
        """The gain by a residual of the quantity of an adjoint, beside its own change."""
        local = -float(adjoint.displacement[: self._owned] @ residual.free[: self._owned])
        for family, gap in zip(self.equations.families, residual.gaps, strict=True):
            local += family.power(adjoint.gaps[family], gap)
        for law, bound, change in zip(self._laws, adjoint.bounds, residual.bounds, strict=True):
            local += float(law.friction.weights @ (bound * change))
        tools = -float(adjoint.displacement[self._owned :] @ residual.free[self._owned :])
        return float(self._comm.allreduce(local)) + tools

    def paired(self, gradient: Gradient, change: Change) -> float:
        """The gain by a change of the quantity of a gradient, beside its own change."""
        local = float(gradient.displacement[: self._owned] @ change.displacement[: self._owned])
        for family, values in gradient.reactions.items():
            local += family.power(change.reactions[family], values)
        tools = float(gradient.displacement[self._owned :] @ change.displacement[self._owned :])
        return float(self._comm.allreduce(local)) + tools

    # Solves.

    def _solve(self, forces: FloatArray, reactions: Reactions) -> _Answer:
        """Solve with the tangent, and again for what rounding, or an iterative solver, leaves."""
        answer = self._nothing()
        for family, values in reactions.items():
            answer.reactions[family][:] += values
        for _ in range(_REFINEMENTS):
            self.solves += 1
            # Reactions and those to the displacement are far larger than their sum.
            elastic = self.tangent.elastic_times(answer.displacement)
            unbalanced = forces - elastic - self.tangent.forces(answer.reactions)
            du = self.tangent.answer(unbalanced, _ITERATIVE)
            seen = {family: family.see(du) for family in self.equations.families}
            blocks = {family: family.block(values) for family, values in seen.items()}
            answer = answer.plus(_Answer(du, seen, blocks))
            if self._size(du) <= _REFINED * self._size(answer.displacement):
                break
        return answer

    def _nothing(self) -> _Answer:
        families = self.equations.families
        seen, reactions = ({f: np.zeros_like(f.seen) for f in families} for _ in range(2))
        return _Answer(self.tangent.zeros(), seen, reactions)

    def _size(self, displacement: FloatArray) -> float:
        owned = displacement[: self._owned]
        return math.sqrt(self._comm.allreduce(float(owned @ owned)))

    def _krylov(
        self,
        pulled: Callable[[FloatArray], Reactions],
        seen: Callable[[_Answer], FloatArray],
        right: FloatArray,
    ) -> tuple[FloatArray, _Answer]:
        """The solution over all bounds of ``b + seen(K^-1 pulled(b)) = right``, and the answer.

        Raises NotConverged.
        """
        solution, residual, start = np.zeros_like(right), right.copy(), self._norm(right)
        moved = self._nothing()
        known: list[tuple[FloatArray, FloatArray, _Answer]] = []
        while self._norm(residual) > _BOUNDS * start:
            if len(known) == _MOST:
                raise NotConverged("the derivative of the friction bounds was not found")
            step = residual.copy()
            answer = self._solve(self.tangent.zeros(), pulled(step))
            image = step + seen(answer)
            for other, other_image, other_answer in known:
                share = self._dot(other_image, image)
                image -= share * other_image
                step -= share * other
                answer = answer.plus(other_answer, -share)
            size = self._norm(image)
            if not size > 0.0:
                raise NotConverged("the derivative of the friction bounds was not found")
            step, image = np.asarray(step / size), np.asarray(image / size)
            answer = self._nothing().plus(answer, 1.0 / size)
            known.append((step, image, answer))
            share = self._dot(image, residual)
            solution += share * step
            residual -= share * image
            moved = moved.plus(answer, share)
        return solution, moved

    def _dot(self, a: FloatArray, b: FloatArray) -> float:
        return float(self._comm.allreduce(float(self._weights @ (a * b))))

    def _norm(self, a: FloatArray) -> float:
        return math.sqrt(self._dot(a, a))

    def destroy(self) -> None:
        """Free the PETSc objects."""
        self.tangent.destroy()
        self.equations.close()


# Products within this share of their mean are alike.
_ALIKE = 0.02
# The share of the way to the end of a cone, and the shortest step that leads anywhere.
_SHARE, _SHORT = 0.9, 0.05
# The product over the density of the elastic energy, and n over E up to which it is so large.
_PRODUCT, _SOFT = 1e-10, 1e4
# No friction bound is a smaller share of the largest.
_LEAST_BOUND = 1e-12


def nearer_the_path(linear: Linearisation) -> SavedState | None:
    """The iterate after a step to the mean product; None where the products are alike; collective.

    None as well where the step leads out of the cones at once.
    """
    equations, comm = linear.equations, linear.equations.system.comm
    families = equations.families
    total = comm.allreduce(sum(family.total() for family in families))
    weight = comm.allreduce(sum(f.scale * float(f.weights.sum()) for f in families))
    if not weight > 0.0:
        return None
    mean = total / weight
    products = [
        (family.x * family.z if family.x.ndim == 1 else dot(family.x, family.z)) / family.scale
        for family in families
    ]
    apart = np.concatenate([np.abs(product / mean - 1.0) for product in products])
    if maximum(comm, apart) <= _ALIKE:
        return None
    change = linear.centring(mean)
    longest = [family.longest_step(step) for family, step in change.steps.items()]
    length = min(1.0, _SHARE * minimum(comm, np.array(longest)))
    if length <= _SHORT:
        return None
    system, owned = equations.system, len(equations.system.load)
    system.u.x.array[:owned] += length * change.displacement[:owned]
    system.u.x.scatter_forward()
    moves = change.displacement[owned:]
    pairs = zip(system.tools.travels, moves, strict=True)
    travels = tuple(float(travel + length * move) for travel, move in pairs)
    cones = tuple(
        (family.x + length * step.primal, family.z + length * step.dual)
        if (step := change.steps.get(family)) is not None
        else None
        for family in equations.every
    )
    return SavedState(system.u.x.array.copy(), travels, equations.target.penalty, cones)


def penalised_iterate(system: System, target: Target, tolerance: float) -> SavedState:
    """The displacement of the system with the cones that its laws give; collective."""
    strain = target.mean_strain(system.energy(), system.largest_displacement(), tolerance)
    product = _PRODUCT * min(max(_SOFT * target.young / target.penalty.n, 0.01), 1.0)
    product *= target.ellipticity * strain**2
    families, owned = families_of(system, target, 0.0), len(system.load)
    displacement = np.append(system.u.x.array[:owned], np.zeros(len(system.tools)))
    cones: list[tuple[FloatArray, FloatArray] | None] = []
    for family in families.every:
        family.update(displacement)
        if isinstance(family, FrictionCones):
            bound = family.nodes.of_all(system.bounds[family.nodes.contact])
            largest = maximum(system.comm, bound)
            if largest == 0.0:
                cones.append(None)
                continue
            family.z[0] = np.maximum(bound, _LEAST_BOUND * largest)
        family.centre(product)
        cones.append((family.x, family.z))
    families.destroy()
    return SavedState(system.u.x.array.copy(), system.tools.travels, target.penalty, tuple(cones))
