"""A solution of the sweep beside others: the truth, a conic solver, the problem in other units."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

from .case import Truth
from .elements import Array
from .judge import FORCE, Judge, complaint
from .observed import Moment
from .reference import Programme
from .transforms import Transform

# Agreement with the conic solver in energy, and in displacement by the energy of the difference;
# the latter for the problem in other units.
_ENERGY, _DIFFERENCE, _TRANSFORMED = 1e-6, 2e-6, 1e-14
# Agreement with a slip that is known, relative to it; and the work of friction in a slip that the
# duality gap leaves open, relative to the energy.
_SLIP, _GAP = 1e-6, 1e-8
# Agreement of a process in other units, relative to its largest energy, and the energies that
# rounding leaves where the modulus is 1 and strains are 1e-5 or more.
_ALIKE, _NOTHING = 1e-5, 1e-20


def against_truth(truth: Truth, judge: Judge, moment: Moment) -> list[str]:
    found = [] if truth.refused is None else [f"solved, but right is: {truth.refused}"]
    if truth.admissible is False and np.isinf(judge.n):
        found.append("nothing is admissible, but it converged")
    size = float(np.abs(moment.u).max(initial=0.0))
    if truth.translation is not None:
        error = float(np.abs(moment.u - truth.translation).max())
        if error > 1e-9 * max(float(np.abs(truth.translation).max()), 1e-9 * judge.extent):
            found.append(f"not the translation: off by {error:.1e}")
    if truth.touches is not None and judge.contacts:
        pairs = zip(judge.contacts, moment.contacts, strict=True)
        force = sum(float(contact.weights @ touch.pressure) for contact, touch in pairs)
        scale = float(judge.body.stiffness.max()) * size * judge.extent ** (judge.mesh.dim - 2)
        if truth.touches and not force > 1e-12 * scale:
            found.append(f"there is a contact force, but {force:.1e} is told")
        if not truth.touches and force > 1e-9 * scale:
            found.append(f"nothing touches, but there is a force of {force:.1e}")
    return found


def slip_of_truth(truth: Truth, judge: Judge, moment: Moment) -> str:
    """How far the slip is off where it is known; "" if it is right.

    It is compared with the displacement by the strain as well, from which it is a difference.
    Where a point sticks by a friction that is weak beside the energy, the solver's duality gap
    leaves a slip whose work is its share of the energy.
    """
    if truth.slip is None:
        return ""
    (contact,), (touch,) = judge.contacts, moment.contacts
    off = float(np.abs(moment.u[contact.nodes, :-1] - truth.slip).max())
    strain = judge.body.strain(moment.u)[0, 0]
    size = float(np.linalg.norm(truth.slip)) + float(np.linalg.norm(strain))
    held = float(contact.weights @ touch.bound)
    energy = judge.body.elastic_forces(moment.u)[2]
    allowed = max(_SLIP * size, _GAP * energy / held if held > 0.0 else 0.0)
    return f"the slip is off by {off:.1e}" if off > allowed else ""


def about_other_solutions(truth: Truth, solution: StudySolution) -> str:
    """A verdict on uniqueness that is false, or not as sharp as it can be; "" if it is right."""
    verdict = str(solution.summary["certificate"]["constants"]["uniqueness"]["verdict"])
    wanted = {None: verdict, True: "covered by theory", False: "not unique"}[truth.unique]
    return "" if verdict == wanted else f"{wanted}, but told to be: {verdict}"


def another(truth: Truth, judge: Judge, moment: Moment) -> str:
    """Why the translation of the truth leads to no solution on either side; "" if it does."""
    if truth.other is None:
        return ""
    told = []
    for side in (1.0, -1.0):
        there = dataclasses.replace(moment, u=moment.u + side * np.array(truth.other))
        told.append(complaint(judge.violations([there])))
    return "" if "" in told else f"the other solution is none: {told}"


def exported(solution: StudySolution, moment: Moment) -> str:
    """Whether the list of contact points, which goes to files, has other tractions than the fields.

    Both are sums over the same nodes, so that their order does not matter.
    """
    points = solution.contact_points
    if points is None:
        return ""
    listed = np.column_stack([points.pressure, points.traction])
    fields = [np.column_stack([touch.pressure, touch.traction]) for touch in moment.contacts]
    sizes = [np.sort(np.linalg.norm(rows, axis=1)) for rows in (listed, np.concatenate(fields))]
    apart = float(np.abs(sizes[0] - sizes[1]).max())
    if apart > FORCE * float(sizes[1][-1]):
        return f"contact points have other tractions than the fields, by {apart:.1e}"
    return ""


def is_unique(parameters: Parameters) -> bool:
    """Whether one solution is to be expected: friction neither large nor dependent on the slip."""
    mu = parameters.friction.coefficient
    return mu is None or (mu.number is not None and mu.number <= 0.5)


def against_reference(judge: Judge, moment: Moment) -> str:
    """How the conic solver differs, at the friction bound of the solution; "" if it agrees.

    Raises NoReference where that solver does not get there.
    """
    programme = Programme(judge, [touch.bound for touch in moment.contacts])
    u, ours = programme.minimiser(), moment.u.ravel()
    K, scale = judge.body.matrix, _energy(judge, moment.u)
    above = (programme.energy(ours) - programme.energy(u)) / scale
    if above > _ENERGY:
        return f"the energy is {above:.1e} above that of the conic solver"
    difference = float((u - ours) @ (K @ (u - ours))) / scale
    if difference > _DIFFERENCE and above > -_ENERGY:
        return f"the conic solver's displacement is another, by {difference:.1e} of the energy"
    return ""


def against_transformed(
    transform: Transform, judge: Judge, moments: Sequence[Moment], others: Sequence[Moment]
) -> tuple[str, float | None]:
    """How the same problem in other units, turned or mirrored, differs; "" if it agrees.

    Of a static problem the energy of the difference comes second.  In steps, and where the place of
    a foundation is unknown, displacements may differ where nothing touches: energies are compared.
    """
    if [moment.time for moment in moments] != [other.time for other in others]:
        return f"{transform} has steps at other times", None
    if "steps" not in judge.study and not any(contact.is_free for contact in judge.contacts):
        apart = transform.back(others[-1].u.ravel()) - moments[-1].u.ravel()
        difference = float(apart @ (judge.body.matrix @ apart)) / _energy(judge, moments[-1].u)
        # Either solution of an iterative solver may miss equilibrium by what the judge allows.
        by_iteration = judge.study.get("solver", {}).get("linear") == "iterative"
        if difference > ((2.0 * FORCE) ** 2 if by_iteration else _TRANSFORMED):
            return f"{transform} differs by {difference:.1e} of the energy", difference
        return "", difference
    power = transform.dim + judge.mesh.axisymmetric
    ours, theirs = (np.array([_energies(moment) for moment in part]) for part in (moments, others))
    theirs = theirs / (transform.stress * transform.length**power)
    nothing = _NOTHING * float(judge.body.stiffness.max()) * judge.extent**power
    off = float(np.abs(ours - theirs).max())
    if off > _ALIKE * float(np.abs(ours[:, 0]).max()) + nothing:
        return f"{transform} has energies that differ by {off:.1e}", None
    return "", None


def _energies(moment: Moment) -> tuple[float, float]:
    """What is stored and, in steps, dissipated."""
    summary = moment.summary
    return summary["elastic_energy"], summary.get("steps", {}).get("dissipated", 0.0)


def _energy(judge: Judge, u: Array) -> float:
    """The energy of a problem, or what rounding makes of none: what differences are parts of."""
    K, flat = judge.body.matrix, u.ravel()
    rounding = 1e-10 * float(np.abs(flat) @ (abs(K) @ np.abs(flat)))
    load = judge.loads(1.0).ravel()
    return max(abs(float(flat @ (K @ flat))), abs(float(load @ flat)), rounding, 1e-300)
