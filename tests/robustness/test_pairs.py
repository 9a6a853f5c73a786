"""The family of pairs: its design has every pair, and its judge knows right from wrong."""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from sweep.covering import pairs_in, pairs_of
from sweep.families import PAIRS, case_of
from sweep.observed import Moment, Touch, mesh_of, moment_of
from sweep.own_body import Mesh
from sweep.pair_features import FEATURES, agree, rows
from sweep.pair_judge import Judge, complaint
from sweep.solve import SOLVED, outcome_of

from contact_locking.running.solving import solve_assembled, solve_steps
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

Study = dict[str, Any]
Judged = tuple[Study, Mesh, tuple[Moment, ...]]


def test_every_compatible_pair_of_values_occurs_and_no_other() -> None:
    found = set().union(*(pairs_in(row) for row in rows()))
    assert found == pairs_of(FEATURES, agree)
    assert 80 <= len(rows()) <= 200


def test_the_problems_are_study_files_and_depend_on_their_seed_alone() -> None:
    count = len(rows())
    for seed in range(count):
        case = case_of(PAIRS, seed)
        assert case.row.split() == list(rows()[seed].values())
        Parameters.model_validate(case.study)
        other = case_of(PAIRS, seed + count)
        assert other.row == case.row
        assert other.study != case.study
    assert case_of(PAIRS, 5) == case_of(PAIRS, 5)


@pytest.mark.parametrize("seed", [4, 5, 11])
def test_a_problem_of_pairs_is_right(seed: int) -> None:
    outcome = outcome_of(PAIRS, seed)
    assert outcome.kind == SOLVED, outcome.reason


@cache
def _solved(n: float, degree: int, gap: float = 1e-3) -> Judged:
    """A block in two steps, of which a part locks, sticks, slips and stands open."""
    study: Study = {
        "mesh": {"builder": "block", "dim": 2, "h": 0.15},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.02},
        "loads": {
            "tractions": [{"on": "top", "value": ["0.04*t", "-0.05*t"]}],
            "displacements": [{"on": "left", "value": [0.0, 0.0]}],
        },
        "contact": [{"on": "bottom", "gap": f"{gap} + 0.02*(1 - x)"}],
        "friction": {
            "coefficient": "0.1/(1 + 100*s)",
            "smoothing": {"kernel": "convolution", "radius": 0.4},
            "regularisation": 0.0 if math.isinf(n) else 1e-6,
        },
        "discretisation": {"degree": degree},
        "penalty": {"n": n} | ({} if math.isinf(n) else {"epsilon": 1e-2}),
        "steps": {"to": 1.0, "count": 2},
    }
    moments = []
    for solution in solve_steps(Parameters.model_validate(study), MPI.COMM_SELF):
        assert solution.converged
        mesh = mesh_of(solution, {"top", "left", "bottom"}, set())
        moments.append(moment_of(solution, mesh))
    return study, mesh, tuple(moments)


_KINDS = [(math.inf, 1), (math.inf, 2), (1e3, 1), (1e3, 2)]


@pytest.mark.parametrize(("n", "degree"), _KINDS)
def test_the_judge_finds_no_fault_with_a_solution(n: float, degree: int) -> None:
    study, mesh, moments = _solved(n, degree)
    assert complaint(Judge(study, mesh).violations(moments)) == ""
    states = moments[-1].contacts[0]
    slides = np.linalg.norm(states.traction, axis=1) > 0.98 * states.bound
    assert (states.pressure > 0.0).any() and slides[states.pressure > 0.0].any()
    assert np.abs(moments[-1].locking).max() > 0.0


Change = Callable[[Moment], Moment]


def _touch(change: Callable[[Touch], Touch]) -> Change:
    return lambda m: dataclasses.replace(m, contacts=tuple(map(change, m.contacts)))


def _shifted(m: Moment) -> Moment:
    """The displacement larger by one per cent."""
    return dataclasses.replace(m, u=1.01 * m.u)


def _bumped(m: Moment) -> Moment:
    """One node off by one per cent of the displacement."""
    u = m.u.copy()
    u[len(u) // 2] += 0.01 * np.abs(u).max()
    return dataclasses.replace(m, u=u)


_pulling = _touch(lambda t: dataclasses.replace(t, pressure=-t.pressure))
_rubbing = _touch(lambda t: dataclasses.replace(t, traction=1.1 * t.traction))
_pushing = _touch(lambda t: dataclasses.replace(t, traction=-t.traction))
_boasting = _touch(lambda t: dataclasses.replace(t, bound=1.01 * t.bound))
_shallow = _touch(lambda t: dataclasses.replace(t, gap=t.gap + 1e-4))


def _soft(m: Moment) -> Moment:
    return dataclasses.replace(m, locking=0.99 * m.locking)


def _unaware(m: Moment) -> Moment:
    return dataclasses.replace(m, elastic=0.99 * m.elastic)


def _lying(m: Moment) -> Moment:
    force = [2.0 * part for part in m.summary["contact_force"]]
    return dataclasses.replace(m, summary=m.summary | {"contact_force": force})


_MISTAKES: list[tuple[Change, str]] = [
    (_shifted, "equilibrium"),
    (_bumped, "equilibrium"),
    (_pulling, "pulling pressure"),
    (_rubbing, "friction above its bound"),
    (_pushing, "friction law"),
    (_boasting, "reported bound"),
    (_shallow, "reported gap"),
    (_soft, "equilibrium"),
    (_unaware, "reported stress"),
    (_lying, "balance of forces"),
]


@pytest.mark.parametrize(("n", "degree"), _KINDS)
@pytest.mark.parametrize(("change", "law"), _MISTAKES, ids=[c.__name__ for c, _ in _MISTAKES])
def test_the_judge_finds_a_mistake(n: float, degree: int, change: Change, law: str) -> None:
    study, mesh, moments = _solved(n, degree)
    found = Judge(study, mesh).violations([*moments[:-1], change(moments[-1])])
    assert found[law] > 1.0, found


@pytest.mark.parametrize(("n", "degree"), _KINDS)
def test_the_judge_finds_a_solution_that_misses_the_foundation(n: float, degree: int) -> None:
    """The solution for a foundation that is farther away is none for a near one."""
    study, mesh, moments = _solved(n, degree, gap=4e-3)
    near = copy.deepcopy(study) | {"contact": _solved(n, degree)[0]["contact"]}
    found = Judge(near, mesh).violations(moments)
    assert found["penetration" if math.isinf(n) else "contact law"] > 1.0
    assert found["reported gap"] > 1.0


def test_the_judge_knows_what_friction_remembers() -> None:
    """Without the first step the second has another slip, and another coefficient."""
    study, mesh, moments = _solved(math.inf, 1)
    found = Judge(study, mesh).violations(moments[1:])
    assert found["friction law"] > 1.0 or found["reported bound"] > 1.0


def test_the_judge_knows_the_strain_beyond_its_limit_and_the_penalty() -> None:
    study, mesh, moments = _solved(math.inf, 1)
    tight = copy.deepcopy(study)
    tight["material"]["locking_limit"] = 0.0199
    assert Judge(tight, mesh).violations(moments)["strain beyond its limit"] > 1.0
    study, mesh, moments = _solved(1e3, 1)
    stiff = copy.deepcopy(study)
    stiff["penalty"]["n"] = 1.01e3
    assert Judge(stiff, mesh).violations(moments)["locking penalty"] > 1.0


def _moved(**told: Any) -> Change:
    """What the summary says of the foundation, made one per cent larger."""

    def change(m: Moment) -> Moment:
        (entry,) = copy.deepcopy(m.summary["contacts"])
        for part, key in told.items():
            entry[part][key] = (1.01 * np.array(entry[part][key])).tolist()
        return dataclasses.replace(m, summary=m.summary | {"contacts": [entry]})

    return change


@pytest.mark.parametrize("dim", [2, 3])
def test_the_judge_knows_the_forces_of_free_foundations(dim: int) -> None:
    down = [*[0.0] * (dim - 1), -1.0]
    foundation: Study = {
        "half_space": {"point": [0.5] * (dim - 1) + [1.0], "normal": down},
        "force": [0.01 * part for part in down],
        "spring": {"stiffness": 0.5},
    }
    study: Study = {
        "mesh": {"builder": "block", "dim": dim, "h": {2: 0.25, 3: 0.5}[dim]},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
        "loads": {"displacements": [{"on": "bottom", "value": [0.0] * dim}]},
        "contact": [{"on": "top", "foundation": foundation}],
        "friction": {"coefficient": 0.3, "smoothing": {"kernel": "none"}},
        "discretisation": {"degree": 1},
        "penalty": {"n": math.inf},
    }
    solution = solve_assembled(assemble(Parameters.model_validate(study), MPI.COMM_SELF))
    mesh = mesh_of(solution, {"top", "bottom"}, set())
    moment, judge = moment_of(solution, mesh), Judge(study, mesh)
    assert complaint(judge.violations([moment])) == ""
    mistakes = [
        (_moved(tool="travel"), "force of a tool"),
        (_moved(tool="direction"), "direction of a tool"),
    ]
    for change, law in mistakes:
        assert judge.violations([change(moment)])[law] > 1.0, law
