"""Equilibria where the interior point method finds none, further ones, and their diagram.

The diagram is a branch of solutions over a share of friction or loads, with its folds.  The
critical friction is the share at which the linearised problem at a solution becomes singular.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.contact.coulomb import Identity
from contact_locking.errors import InputError, NotConverged
from contact_locking.parallel import maximum, minimum
from contact_locking.results.contact_points import OPEN
from contact_locking.solver.interior_point.method import InteriorPoint
from contact_locking.solver.task import Counts, Outcome, Task, stage_of
from contact_locking.theory.bound_map import (
    BoundMap,
    Branch,
    BranchPoint,
    Deflation,
    MapNewton,
    OverShare,
)

# Tresca's problems need to be solved this much more sharply than the bounds, and those with bounds
# far above the pressure without friction take so many times the iterations.
_SHARPER, _LONGER = 0.1, 3
# The most nodes with friction that the dense derivative is made for, and the most points of the
# branch from no friction and of one from a solution.
_MOST_NODES, _MOST_POINTS, _FEWER_POINTS = 1500, 100, 40
# Without a penalty a branch ends where the bounds are so many times those without friction: they
# grow without a limit where friction wedges the body in.  With a penalty they have a limit.
FARTHEST = 300.0
# A branch is followed up to this share of the friction.
_BEYOND = 2.0
# Known solutions times these are starts of further searches, and so are shares of the bounds that
# the pressure without friction asks for, or the mean stress of the body where nothing presses.
_BESIDE, _SHARES, _SHARES_OF_STRESS = (1.02, 0.5, 1.5, 0.1), (0.0, 1.0, 2.0), (1.0, 0.1)


def has_map(task: Task) -> bool:
    """Whether the map of friction bounds has values everywhere, and a derivative; collective."""
    system, rubbing = task.system, task.system.rubbing
    knows = all(contact.friction.is_coulomb for contact in rubbing)
    if not (rubbing and knows) or system.held_by_friction:
        return False
    nodes = system.comm.allreduce(sum(int(np.count_nonzero(contact.free)) for contact in rubbing))
    return bool(0 < nodes <= _MOST_NODES)


def sharpened(task: Task) -> Task:
    """The task with the settings that values of the map need."""
    settings = task.settings
    sharper, longer = _SHARPER * settings.tolerance, _LONGER * settings.max_iterations
    settings = settings.model_copy(update={"tolerance": sharper, "max_iterations": longer})
    return replace(task, settings=settings)


def solved_from(task: Task, value: Outcome) -> Outcome:
    """The solution near a value of the map, with bounds that follow the pressure; collective."""
    assert value.last is not None
    solver = InteriorPoint(task)
    try:
        return solver.solve(value.last, by_pieces_alone=True)
    finally:
        solver.destroy()


class Equilibria:
    """The fixed points of the map of the friction bounds of a task, found one after the other.

    ``counts`` is for what they take.  The constructor is collective, as all methods are.
    """

    def __init__(self, task: Task) -> None:
        self._task, self.counts = task, Counts()
        self.map = BoundMap(sharpened(task.aside(self.counts)))
        self._newton = MapNewton(self.map, task.settings.friction_tolerance)

    def on_branch(
        self, start: FloatArray | None = None, direction: float = 1.0
    ) -> Iterator[FloatArray]:
        """The solutions on the branch over the share of friction."""
        branch, before = Branch(OverShare(self.map)), None
        is_strict = self._task.target.penalty.is_strict
        most = _MOST_POINTS if start is None else _FEWER_POINTS
        for point in itertools.islice(branch.points(start, direction), most):
            if point.share > _BEYOND or (is_strict and branch.reach > FARTHEST):
                return
            if before is not None and (point.share - 1.0) * (before.share - 1.0) < 0.0:
                solution = self._within(before, point)
                if solution is not None:
                    yield solution
            before = point

    def _within(self, before: BranchPoint, point: BranchPoint) -> FloatArray | None:
        """A solution near the place where the branch passes the whole share.

        Between two points whose nodes stick, slip or touch otherwise, Newton's method may
        go to and fro, where it arrives from one of them.
        """
        starts = (before.between(point, 1.0), point.bounds, before.bounds)
        tries = (self._solve(start) for start in starts)
        return next((bounds for bounds in tries if bounds is not None), None)

    def _solve(self, start: FloatArray, deflation: Deflation | None = None) -> FloatArray | None:
        """The bounds of a solution from a start, None if none was found; collective."""
        bounds = self._newton.solve(start, deflation)
        if bounds is None or self._newton.residual <= self._newton.tolerance:
            return bounds
        with contextlib.suppress(NotConverged):
            self._solved()
            settled = self.map.vectors.in_force()
            return None if deflation and deflation.is_known(settled) else settled
        return None

    def _solved(self) -> Outcome:
        return solved_from(self._task.aside(self.counts), self.map.outcome)

    def others(self, first: FloatArray) -> Iterator[FloatArray]:
        """Solutions beside a known one: those on branches, then those that deflation finds.

        The branch of each solution over the share of friction may lead to others.  Nothing tells
        that there are no others.
        """
        vectors = self.map.vectors
        # Near a fold the bounds of the interior point method are rougher than their tolerance.
        refined = self._solve(first)
        known = [first if refined is None else refined]
        without: FloatArray = self.map(np.zeros(vectors.size))
        shares: tuple[float, ...] = _SHARES
        if not vectors.norm(without) > 0.0:
            without, shares = self._of_mean_stress(), _SHARES_OF_STRESS
        deflation = Deflation(vectors, known, vectors.norm(first) or vectors.norm(without))
        apart = [share * without for share in shares]
        followed, tried = 0, 0
        branches: Iterator[FloatArray] = self.on_branch()
        while True:
            for end in branches:
                if not deflation.is_known(end):
                    known.append(end)
                    yield end
            if followed < 2 * len(known):
                branches = self.on_branch(known[followed // 2], 1.0 - 2.0 * (followed % 2))
                followed += 1
                continue
            starts = [*apart, *(share * bounds for bounds in known for share in _BESIDE)]
            while tried < len(starts):
                new = self._solve(starts[tried], deflation)
                tried += 1
                if new is not None:
                    known.append(new)
                    yield new
                    break
            else:
                return

    def _of_mean_stress(self) -> FloatArray:
        """The bounds of a pressure as large as the mean stress of the body without friction."""
        task, system = self._task, self._task.system
        energy, displacement = system.elastic_energy(), system.largest_displacement()
        strain = task.target.mean_strain(energy, displacement, task.settings.tolerance)
        pressure = task.target.mean_stress(strain)
        bounds = []
        for contact in self.map.vectors.contacts:
            ones = np.ones(len(contact.free))
            bounds.append(contact.acting(contact.friction.evaluate(pressure * ones, 0.0 * ones)))
        return self.map.vectors.gather(bounds)

    def index(self) -> int:
        """The sign of ``det(I - Phi'(G))`` at the last value of the map, 0 if it is singular.

        The signs of all solutions add up to 1 where they are regular and Phi is continuous and
        bounded, by the degree of Leray and Schauder.
        """
        slope = np.eye(self.map.vectors.size) - self.map.derivative()
        return int(self.map.vectors.solved(slope, slope[0])[1])

    def solve_under(self, bounds: FloatArray) -> Outcome:
        """Put the solution with these bounds into the system; collective.  Raises NotConverged."""
        image, norm = self.map(bounds), self.map.vectors.norm
        change = norm(image - bounds) / (norm(image) or 1.0)
        if change > self._newton.tolerance:
            return self._solved()
        return replace(self.map.outcome, friction_change=change)

    def destroy(self) -> None:
        """Free the PETSc objects, and count for the task what was taken."""
        self._task.counts.add(self.counts)
        self.map.destroy()


def require_map(task: Task, key: str = "equilibria") -> None:
    """Raise InputError, for a key, where other equilibria cannot be searched; collective."""
    if not has_map(task):
        raise InputError(
            f"needs friction, a body that is not held by friction alone, and at most {_MOST_NODES} "
            "nodes with friction",
            key,
        )


def equilibria(task: Task, first: Outcome, most: int) -> Iterator[tuple[Outcome, int]]:
    """The solution in the system, and others, so many at most, each in the system in its turn.

    Each comes as its report and its index (:meth:`Equilibria.index`).  ``first`` is the report of
    the solution in the system.  Collective.  Raises InputError as :func:`require_map`.
    """
    require_map(task)
    search = Equilibria(task)
    try:
        vectors = search.map.vectors
        known, counts = vectors.in_force(), search.counts
        with task.system.preserved():
            search.map(known)
            index = search.index()
        yield first, index
        for bounds in itertools.islice(search.others(known), most - 1):
            before = replace(counts)
            outcome = search.solve_under(bounds)
            cost = Counts(counts.tangents - before.tangents, counts.linear - before.linear)
            task.monitor.counted(cost.tangents, cost.updates)
            with task.system.preserved():
                index = search.index()
            stages = [stage_of(task.target.penalty, cost.tangents)]
            yield outcome.with_counts(cost, stages), index
    finally:
        search.destroy()


# The most points of a diagram.
_MOST_OF_DIAGRAM = 150
_STOPPED = "no further step along the branch was found"


@dataclass(frozen=True)
class DiagramPoint:
    """A solution with its ``share``, and its totals over all contacts with friction.

    ``pressure`` is ``int p`` and ``bound`` is ``int G``.  ``index`` is the sign of
    ``det(I - dPsi/dG)``, 0 at a fold, where the share turns and ``fold`` is 1.
    """

    share: float
    pressure: float
    bound: float
    index: int
    fold: int


@dataclass(frozen=True)
class Diagram:
    """The points in the order of the branch, and why it ends, in words."""

    points: tuple[DiagramPoint, ...]
    end: str

    @property
    def folds(self) -> list[float]:
        """The shares at which the branch turns."""
        return [point.share for point in self.points if point.fold]


#: The diagram over loads without a solution for the whole of them.
NO_START = Diagram((), "it begins at the solution for all of the loads, which was not found")


def diagram(task: Task, to: float, put: Callable[[float], None] | None = None) -> Diagram:
    """The branch from no friction up to ``to`` times the friction; collective.

    With ``put``, which gives a share of the loads to the system, it is the branch over the loads,
    from the solution in the system with the share 1 up or down to the share ``to``.  The system is
    left as it was.  Raises InputError where there is no map of the friction bounds.
    """
    require_map(task, "branches")
    equilibria = Equilibria(task)
    problem, vectors = equilibria.map, equilibria.map.vectors
    path, onwards = OverShare(problem, put), -1.0 if put is not None and to < 1.0 else 1.0
    start = None if put is None else vectors.in_force()
    points, end, branch = [], _STOPPED, Branch(path, locates_folds=True)
    try:
        with task.system.preserved():
            for point in itertools.islice(branch.points(start, onwards), _MOST_OF_DIAGRAM):
                try:
                    path(point.bounds, point.share)
                except NotConverged:
                    break
                pressure = vectors.dot(problem.pressures(), vectors.ones)
                bound, is_fold = vectors.dot(point.bounds, vectors.ones), int(point.sign == 0.0)
                sign = int(point.sign)
                points.append(DiagramPoint(point.share, pressure, bound, sign, is_fold))
                grows = branch.reach > FARTHEST * max(1.0, point.share)
                if task.target.penalty.is_strict and grows:
                    of = "the pressure without friction" if put is None else "all of the loads"
                    end = f"the friction bound is {branch.reach:.0f} times that of {of}, and grows"
                    break
                if onwards * (point.share - to) >= 0.0:
                    end = "the last share was reached"
                    break
            else:
                if len(points) == _MOST_OF_DIAGRAM:
                    end = f"after {_MOST_OF_DIAGRAM} points"
    finally:
        if put is not None:
            put(1.0)
        equilibria.destroy()
    if points and end == _STOPPED:
        end = f"it stopped at the share {points[-1].share:.4g}, as {_STOPPED}"
    if not points and put is None:
        end = "no node presses without friction, so that no share of it does anything"
    return Diagram(tuple(points), end)


# An eigenvalue counts as real whose imaginary part is a smaller share of it, and as none that is a
# smaller share of the norm: the derivative comes from the end of a central path.
_REAL, _NONE = 1e-8, 1e-6


def critical_friction(state: SolvedState) -> dict[str, Any]:
    """``min {t > 0: I - t Phi'(G) is singular}`` at the bounds G of a solution; collective.

    Phi is the map of :mod:`contact_locking.theory.bound_map`, for the coefficient mu.
    With ``t mu`` in the place of mu, and the same points that stick, slip and are open, the
    linearised problem has more than one solution: the eigenvalue problem of Hassani, Hild,
    Ionescu and Sakki (doi:10.1016/S0045-7825(03)00419-5).  ``share`` is t, None if no t is
    critical; ``coefficient`` is ``t mu``, None also where mu is not the same everywhere and at
    every slip.  ``mode_peak`` is the place where the bound of the eigenvector is largest.
    """
    none: dict[str, Any] = dict.fromkeys(("share", "coefficient", "mode_peak"))
    task = Task(state.system, state.target, state.settings).aside(Counts())
    if not has_map(task):
        return {
            **none,
            "reason": "there is no friction with a coefficient, friction alone holds the body, or "
            "Gamma_C has too many nodes",
        }
    with state.system.preserved():
        problem = BoundMap(task)
        try:
            vectors = problem.vectors
            problem(vectors.in_force())
            pair = critical_share(_of_laws(problem, state))
        except NotConverged as failure:
            return {**none, "reason": str(failure)}
        finally:
            problem.destroy()
    pair = state.comm.bcast(pair)
    if pair is None:
        return {**none, "reason": "no share of friction is critical for this state of the contact"}
    share, mode = pair
    parts = [contact.surface.points[contact.free] for contact in vectors.contacts]
    coordinates = zip(*(points.T for points in parts), strict=True)
    places = np.stack([vectors.join(list(values)) for values in coordinates], axis=1)
    values = np.concatenate(
        [each.friction.coefficient(np.zeros(len(each.free))) for each in state.system.rubbing]
    )
    mu, smallest = maximum(state.comm, values), minimum(state.comm, values)
    falls = any(contact.friction.depends_on_slip for contact in state.system.rubbing)
    return {
        "share": share,
        "coefficient": None if falls or mu != smallest else share * mu,
        "mode_peak": places[int(np.argmax(np.abs(mode)))].tolist(),
    }


def _of_laws(problem: BoundMap, state: SolvedState) -> FloatArray:
    """``Phi'`` (m, m) at the last value, without what a central path leaves; collective.

    A node that sticks answers no change of its bound, and an open node without a smoothing R has
    no bound, whatever the bounds of the others are.
    """
    vectors = problem.vectors
    rubbing = [fields for fields in state.contacts if fields.contact in vectors.contacts]
    answers = vectors.gather([np.where(fields.holds, 0.0, 1.0) for fields in rubbing])
    has_bound = []
    for fields in rubbing:
        is_local = isinstance(fields.contact.friction.smoothing, Identity)
        has_bound.append(np.where(is_local & (fields.state == OPEN), 0.0, 1.0))
    return vectors.gather(has_bound)[:, None] * problem.derivative() * answers


def critical_share(derivative: FloatArray) -> tuple[float, FloatArray] | None:
    """The least t > 0 with ``I - t J`` singular, for J (m, m), and the eigenvector; None without.

    t is one over the largest of the positive eigenvalues of J.
    """
    values, vectors = np.linalg.eig(derivative)
    least = _NONE * float(np.linalg.norm(derivative))
    is_real = (np.abs(values.imag) <= _REAL * np.abs(values)) & (values.real > least)
    if not np.any(is_real):
        return None
    place = int(np.argmax(np.where(is_real, values.real, -math.inf)))
    return 1.0 / float(values[place].real), np.real(vectors[:, place])
