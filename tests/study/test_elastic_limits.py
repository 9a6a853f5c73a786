"""Limits of the elastic strain: free expansion, restraint, loads, steps, proofs, derivatives."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import rollers_of, with_changes

from contact_locking import solve
from contact_locking.parallel import maximum
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

YOUNG, POISSON, WARM, LIMIT = 2.0, 0.3, 0.004, 0.001
BODIES = [
    (2, False, 1, "simplex"),
    (2, False, 2, "simplex"),
    (2, False, 1, "box"),
    (3, False, 1, "simplex"),
    (3, False, 1, "box"),
    (2, True, 1, "simplex"),
]
NORMS: list[dict[str, Any]] = [
    {"norm": "strain", "at_most": LIMIT},
    {"norm": "deviator", "at_most": LIMIT},
    {"norm": "volume", "at_most": LIMIT, "at_least": -LIMIT},
    {"norm": "direction", "along": [1.0, 2.0, 0.5], "at_most": LIMIT, "at_least": -LIMIT},
]


def body(
    dim: int = 3, axisymmetric: bool = False, degree: int = 1, cells: str = "simplex", **given: Any
) -> Parameters:
    """A block that is free to expand away from its lower left corner, and strictly limited."""
    rollers = rollers_of(dim, axisymmetric)
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": 0.5},
        "discretisation": {"degree": degree},
        "material": {
            "elasticity": {"young": YOUNG, "poisson": POISSON},
            # The same in the plane as in space.
            "eigenstrain": {"value": [WARM, WARM, 0.0] if dim == 2 and not axisymmetric else WARM},
            "locking_limit": LIMIT,
            "limits_of": "elastic",
        },
        "loads": {"displacements": rollers},
        "contact": {"on": []},
        "penalty": {"n": math.inf},
    }
    if axisymmetric:
        data["mesh"]["axisymmetric"] = True
    if cells == "box":
        data["mesh"] |= {"cells": "box", "structured": True}
    return with_changes(data, **given)


def solved(parameters: Parameters, comm: MPI.Intracomm) -> StudySolution:
    found = solve(parameters, comm)
    assert found.converged, found.summary["reason"]
    return found


def certified(found: StudySolution) -> dict[str, Any]:
    told: dict[str, Any] = found.summary["certificate"]
    assert all(item["holds"] for item in told["criteria"].values()), told["criteria"]
    return told


def is_impossible(found: StudySolution) -> bool:
    return not found.converged and found.summary["reason"].startswith("infeasible")


@pytest.mark.parametrize("n", [math.inf, 1e3])
@pytest.mark.parametrize(("dim", "axisymmetric", "degree", "cells"), BODIES)
def test_free_expansion_locks_by_the_total_and_not_by_the_elastic_strain(
    dim: int, axisymmetric: bool, degree: int, cells: str, n: float, comm: MPI.Intracomm
) -> None:
    kind = dim, axisymmetric, degree, cells
    free = solved(body(*kind, penalty__n=n), comm)
    certified(free)
    across = dim == 2 and not axisymmetric
    sides = 2 if across else 3
    assert free.summary["strain_norm_max"] < 1e-10
    assert free.summary["locked_fraction"] == 0.0
    assert maximum(comm, np.abs(free.locking_stress.x.array)) < 1e-10
    whole = solved(body(*kind, penalty__n=n, material__limits_of="total"), comm)
    assert whole.summary["locked_fraction"] == 1.0
    if math.isinf(n):
        assert whole.summary["strain_norm_max"] == pytest.approx(LIMIT, rel=1e-6)
    moved = free.summary["displacement_max"]
    # Two normal strains let the plane expand alone; the body of revolution has no strain across.
    assert moved == pytest.approx(WARM * math.sqrt(2 if axisymmetric else sides), rel=1e-8)


@pytest.mark.parametrize("norm", NORMS, ids=lambda item: item["norm"])
def test_no_limit_acts_on_free_expansion(norm: dict[str, Any], comm: MPI.Intracomm) -> None:
    found = solved(body(material__locking=[norm], material__locking_limit=math.inf), comm)
    assert found.summary["locked_fraction"] == 0.0
    assert maximum(comm, np.abs(found.locking_stress.x.array)) < 1e-10
    certified(found)


def test_the_largest_principal_strain_may_be_the_elastic_one(comm: MPI.Intracomm) -> None:
    limits: dict[str, Any] = {
        "material__locking": [{"norm": "largest_principal", "at_most": LIMIT}],
        "material__locking_limit": math.inf,
    }
    found = solved(body(2, **limits), comm)
    assert found.summary["locked_fraction"] == 0.0
    pulled = [{"on": "right", "value": [WARM + 2.0 * LIMIT, None]}]
    held = body(2).loads.model_dump(exclude_unset=True)["displacements"]
    failed = solve(body(2, **limits, loads={"displacements": [*held, *pulled]}), comm)
    assert is_impossible(failed)


@pytest.mark.parametrize("cells", ["simplex", "box"])
def test_a_load_stretches_the_heated_body_by_the_limit(cells: str, comm: MPI.Intracomm) -> None:
    """``u_z = (e + M) z`` under a traction p > E M, with the locking stress ``p - E M``."""
    pull = 5.0 * YOUNG * LIMIT
    found = solved(
        body(
            cells=cells,
            material__locking=[{"norm": "direction", "along": [0.0, 0.0, 1.0], "at_most": LIMIT}],
            material__locking_limit=math.inf,
            loads__tractions=[{"on": "top", "value": [0.0, 0.0, pull]}],
        ),
        comm,
    )
    told = certified(found)
    u = found.displacement.x.array.reshape(-1, 3)
    x = found.displacement.function_space.tabulate_dof_coordinates()
    wide = WARM - POISSON * LIMIT
    assert maximum(comm, np.abs(u - x * [wide, wide, WARM + LIMIT])) < 1e-8
    locking = found.locking_stress.x.array.reshape(-1, 3, 3)
    assert np.allclose(locking[:, 2, 2], pull - YOUNG * LIMIT, rtol=1e-5)
    # The body at rest is admissible: its fibres are shorter than without stress.
    assert all(bound["holds"] for bound in told["bounds"].values())


def test_the_bounds_of_the_theory_hold_where_rest_is_admissible(comm: MPI.Intracomm) -> None:
    pull = [{"on": "top", "value": [0.0, 0.0, 0.05]}]
    for n in (math.inf, 1e3):
        found = solved(
            body(material__locking_limit=0.01, loads__tractions=pull, penalty__n=n), comm
        )
        assert found.summary["locked_fraction"] == 1.0
        for bound in certified(found)["bounds"].values():
            assert bound["holds"] and bound["bound"] > bound["value"] > 0.0


def test_no_bound_of_the_theory_is_given_where_rest_is_not_admissible(comm: MPI.Intracomm) -> None:
    for bound in certified(solved(body(), comm))["bounds"].values():
        assert bound["bound"] is None and "exceeds the locking limit" in bound["reason"]


def test_heat_that_nothing_can_follow_is_proved(comm: MPI.Intracomm) -> None:
    """A body held all around has the elastic strain ``-e I``."""
    parts = [["left", "right"], ["front", "back"], ["bottom", "top"]]
    held = [
        {"on": names, "value": [0.0 if axis == number else None for axis in range(3)]}
        for number, names in enumerate(parts)
    ]
    limit = 0.9 * WARM * math.sqrt(3.0)
    given: dict[str, Any] = {"loads": {"displacements": held}, "material__locking_limit": limit}
    failed = solve(body(**given), comm)
    assert is_impossible(failed)
    assert "the elastic strain is forced to" in failed.summary["reason"]
    # The same displacements are admissible beside 1.2 times the limit, and with a penalty.
    assert solved(body(**given | {"material__locking_limit": 1.2 * limit}), comm)
    soft = solved(body(**given, penalty__n=100.0), comm)
    wanted = -200.0 * (WARM * math.sqrt(3.0) - limit) / math.sqrt(3.0)
    locking = soft.locking_stress.x.array.reshape(-1, 3, 3)
    assert np.allclose(locking, wanted * np.eye(3), rtol=1e-5, atol=1e-8)


def test_the_share_that_can_follow_counts_from_the_expansion(comm: MPI.Intracomm) -> None:
    """A fibre along x is stretched by ``s``, and stays in ``e - M <= s <= e + M``."""
    given: dict[str, Any] = {
        "material__locking": [
            {"norm": "direction", "along": [1.0, 0.0, 0.0], "at_most": LIMIT, "at_least": -LIMIT}
        ],
        "material__locking_limit": math.inf,
    }
    held = body().loads.model_dump(exclude_unset=True)["displacements"]

    def stretched(by: float) -> StudySolution:
        moved = {"on": "right", "value": [by, None, None]}
        return solve(body(**given, loads={"displacements": [*held, moved]}), comm)

    far = stretched(2.0 * (WARM + LIMIT))
    assert is_impossible(far)
    assert "49.8 to 50" in far.summary["reason"] or "50 %" in far.summary["reason"]
    assert stretched(0.99 * (WARM + LIMIT)).converged
    near = stretched(0.5 * (WARM - LIMIT))
    assert is_impossible(near)


@pytest.mark.parametrize("n", [math.inf, 200.0])
def test_steps_of_heat_and_load_balance_their_energies(n: float, comm: MPI.Intracomm) -> None:
    """The limits move with the heat, and the load locks the body before and after."""
    steps = {"to": 2.0, "count": 4}
    warm = {"expansion": WARM, "temperature": "max(t - 1, 0)"}
    pull = [{"on": "top", "value": [0.0, 0.0, "0.01*min(t, 1)"]}]
    found = solved(
        body(material__eigenstrain=warm, loads__tractions=pull, steps=steps, penalty__n=n), comm
    )
    rows = found.history.rows
    assert [row["locked_fraction"] for row in rows] == [1.0] * 4
    assert all(row["energy_defect"] < 1e-7 for row in rows)
    # Heat lifts the load and changes nothing else.
    assert rows[3]["stored"] == pytest.approx(rows[1]["stored"], rel=1e-3)
    assert abs(rows[3]["numerical"]) < 1e-7 * rows[1]["stored"] + 1e-12


def test_derivatives_by_heat_know_that_the_limits_move(comm: MPI.Intracomm) -> None:
    names, key = ["reactions.top.2", "elastic_energy"], "material.eigenstrain.value"
    loads = {
        "displacements": [
            {"on": "bottom", "value": [0.0, 0.0, 0.0]},
            {"on": "top", "value": [0.0, 0.0, 0.006]},
        ]
    }
    given: dict[str, Any] = {"loads": loads, "penalty__n": 50.0}
    found = solved(body(**given, sensitivities={"of": names, "to": [key]}), comm).summary
    ends = []
    for value in (1.001 * WARM, 0.999 * WARM):
        summary = solved(body(**given, material__eigenstrain__value=value), comm).summary
        ends.append([summary["reactions"]["top"][2], summary["elastic_energy"]])
    slopes = (np.array(ends[0]) - np.array(ends[1])) / (0.002 * WARM)
    told = [found["sensitivities"][name][key]["derivative"] for name in names]
    assert told == pytest.approx(slopes.tolist(), rel=1e-3)


def test_limits_of_the_elastic_strain_need_an_eigenstrain_and_its_tensor() -> None:
    with pytest.raises(ValueError, match="elastic needs an eigenstrain"):
        body(material__eigenstrain=[])
    for norm in NORMS[1:3]:
        with pytest.raises(ValueError, match="does not go with limits_of: elastic in 2D"):
            body(2, material__locking=[norm], material__locking_limit=math.inf)


def test_no_limit_load_is_given_for_limits_of_the_elastic_strain(comm: MPI.Intracomm) -> None:
    held = body(2).loads.model_dump(exclude_unset=True)["displacements"]
    pulled = {"on": "right", "value": [WARM, None]}
    given: dict[str, Any] = {
        "loads": {"displacements": [*held, pulled]},
        "certificate__error_bound": True,
    }
    told = solved(body(2, **given), comm).summary["certificate"]["limit_load"]
    assert told["infeasible"] is None
    assert "no proof covers limits of the elastic strain" in told["reason"]
