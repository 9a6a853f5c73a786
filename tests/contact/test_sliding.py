"""Bodies that slide over several facets of each other, and are paired anew in each step."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import solved
from two_bodies import stack

import contact_locking as cl
from contact_locking import StudySolution, save, solve, solve_steps, study_file
from contact_locking.errors import InputError
from contact_locking.study_file.parameters import Parameters

pytest.importorskip("gmsh")

LENGTH = 1.0


def sliding(dim: int = 2, pair: str = "each_step", to: float = 1.0, **changes: Any) -> Parameters:
    """A narrow block that is pressed on a wide one, and slides over it to the right."""
    rest = [0.0] * (dim - 2)
    given: dict[str, Any] = {
        "mesh__size": [3.0, *[1.0] * (dim - 1)],
        "mesh__upper": [0.6] * dim,
        "contact": {"on": "upper_bottom", "against": "lower_top", "pair": pair},
        "friction__coefficient": 0.3,
        "loads": {
            "displacements": [
                {"on": "bottom", "value": [0.0] * dim},
                {"on": "top", "value": [f"{LENGTH}*t", *rest, -0.01]},
            ]
        },
        "steps": {"to": to, "count": round(8 * to)},
    }
    return stack(dim, 0.2 if dim == 2 else 0.5, **given | changes)


def last_forces(parameters: Parameters) -> tuple[StudySolution, Any, Any]:
    """The last solution, the places (k, d) of all nodes when they were paired, and the forces."""
    for solution in solve_steps(parameters):
        assert solution.converged, solution.summary["reason"]
        # The solver still has the map between the sides.
        places, forces = forces_at(solution)
    return solution, places, forces


def forces_at(solution: cl.Solution) -> tuple[Any, Any]:
    (fields,) = solution.contacts
    dim, space = solution.domain.dim, solution.displacement.function_space
    tractions = fields.traction - fields.pressure[:, None] * fields.normal
    owned = space.dofmap.index_map.size_local
    forces = fields.surface.nodal_forces(tractions).reshape(-1, dim)[:owned]
    before = np.zeros_like(forces)
    if fields.paired_at is not None:
        before = fields.paired_at.reshape(-1, dim)[:owned]
    places = space.tabulate_dof_coordinates()[:owned, :dim] + before
    comm = solution.domain.comm
    return np.concatenate(comm.allgather(places)), np.concatenate(comm.allgather(forces))


@pytest.mark.parametrize(("dim", "cells"), [(2, "simplex"), (3, "simplex"), (3, "box")])
def test_a_block_presses_where_it_has_slid_to(dim: int, cells: str) -> None:
    """Over five facets in 2D: forces and moments balance, and the pressure is below the block."""
    grids: dict[str, Any] = {"mesh__cells": cells, "mesh__structured": cells == "box"}
    solution, places, forces = last_forces(sliding(dim, **grids))
    assert solution.summary["warnings"] == []
    normal = float(np.abs(forces[:, -1]).sum()) / 2.0
    assert np.abs(forces.sum(axis=0)).max() <= 1e-12
    moment = places[:, 0] @ forces[:, -1] - places[:, -1] @ forces[:, 0]
    # The arm of the gap between bent sides.
    assert abs(moment) <= 2e-3 * normal * 0.6
    # The nodes of the lower block with forces are below the block, or at the next facet.
    is_lower = places[:, -1] < 1.0 - 1e-12
    pressed = places[is_lower & (np.abs(forces[:, -1]) > 1e-9 * normal)]
    left = 1.2 + LENGTH * 7.0 / 8.0
    length = 0.25 if dim == 2 else 0.7
    assert left - length <= pressed[:, 0].min() <= left + 0.05
    assert left + 0.55 <= pressed[:, 0].max() <= left + 0.6 + length
    # Friction has its full size all the way.
    history = solution.history.rows
    dissipated = sum(row["dissipated"] for row in history)
    forces_up = [row["contact_force_y" if dim == 2 else "contact_force_z"] for row in history]
    assert dissipated == pytest.approx(0.3 * np.mean(forces_up) * LENGTH, rel=0.1)


def test_a_pairing_that_is_slid_over_is_told_of() -> None:
    solution, places, forces = last_forces(sliding(pair="once"))
    (finding,) = solution.warnings
    assert finding.code == "contact.sliding"
    assert finding.numbers["facets"] == pytest.approx(5.0, rel=0.05)
    # The pressure stays where the block was.
    assert places[forces[:, 1] < -1e-9, 0].max() < 2.1
    # In two steps the pressure is where the block has come to as well.
    few, places, forces = last_forces(sliding(steps={"to": 1.0, "count": 2}))
    assert not few.summary["warnings"]
    assert places[forces[:, 1] < -1e-9, 0].min() > 1.8


def test_pairs_that_nobody_can_find_are_refused() -> None:
    with pytest.raises(ValueError, match="does not go with sensitivities"):
        sliding(sensitivities={"of": ["contact_force.1"], "to": ["material.elasticity.young"]})
    with pytest.raises(ValueError, match="is about two bodies"):
        sliding(contact={"on": "upper_bottom", "pair": "each_step"})
    assert study_file.dump(sliding()).count("each_step") == 1
    # A block that has slid off the other one.
    far = {"on": "top", "value": ["3*t", -0.01]}
    held = [{"on": "bottom", "value": [0.0, 0.0]}, far]
    with pytest.raises(InputError, match="meet no facet of lower_top"):
        solve(sliding(loads={"displacements": held}))


def test_a_step_after_a_pairing_anew_goes_on_from_a_checkpoint(tmp_path: Path) -> None:
    folder = Path(MPI.COMM_WORLD.bcast(str(tmp_path))) / "saved"
    whole = solved(sliding())
    save(solved(sliding(to=0.5)), folder)
    rest = solve(sliding(), restart=folder)
    for key in ("friction_force", "slip_max", "elastic_energy", "pressure_max"):
        assert rest.summary[key] == pytest.approx(whole.summary[key], rel=1e-6, abs=1e-9)
