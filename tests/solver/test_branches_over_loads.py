"""Branches of solutions over loads: a snap with a closed form, and an equilibrium that is lost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from sweep.case import Study, clamp, study

import contact_locking as cl
from contact_locking.mesh.sources import from_geometry
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters


@pytest.mark.serial
def test_a_branch_leads_on_where_nodes_begin_to_slip() -> None:
    """``k s + mu(s) P = T`` for a stiff block: a fold where it begins to slip, and another one."""
    stiffness, pressure, pull = 0.05, 0.01, 0.0055
    data = study(
        {"builder": "block", "dim": 2, "h": 0.5, "structured": True},
        {
            "springs": [{"on": "left", "stiffness": stiffness, "along": [1.0, 0.0]}],
            "tractions": [
                {"on": "top", "value": [0.0, -pressure]},
                {"on": "right", "value": [pull, 0.0]},
            ],
        },
        young=1000.0,
        poisson=0.2,
        friction="0.2 + 0.5*exp(-s/0.01)",
        smoothing={"kernel": "none"},
    )
    data["branches"] = {"over": "loads.tractions.1.value", "to": 1.6}
    found = solving.solve(Parameters.model_validate(data), MPI.COMM_SELF).summary["branches"]
    assert found["end"] == "the last share was reached"
    # The second fold is where ``k = 50 P exp(-s/0.01)``.
    slip = 0.01 * math.log(50.0 * pressure / stiffness)
    turn = (stiffness * slip + (0.2 + stiffness / 50.0 / pressure * 0.5) * pressure) / pull
    assert found["folds"] == pytest.approx([0.7 * pressure / pull, turn], rel=2e-4)


def _clamped(**sections: Any) -> Study:
    data = study(
        {"builder": "block", "dim": 2, "h": 0.5, "structured": True},
        {"displacements": [clamp(2)], "tractions": [{"on": "top", "value": [0.004, -0.02]}]},
        friction=0.3,
        smoothing={"kernel": "convolution", "radius": 0.3},
    )
    return data | sections


@pytest.mark.parametrize("to", [1.5, 0.5])
def test_without_a_gap_the_solution_is_proportional_to_the_loads(to: float) -> None:
    data = _clamped(branches={"over": "loads", "to": to})
    found = solving.solve(Parameters.model_validate(data)).summary["branches"]
    points = found["points"]
    assert found["end"] == "the last share was reached"
    assert found["folds"] == []
    assert points["share"][0] == 1.0
    assert (points["share"][-1] - to) * (to - 1.0) >= 0.0
    for name in ("pressure", "bound"):
        slopes = np.array(points[name]) / np.array(points["share"])
        assert slopes == pytest.approx(slopes[0] * np.ones(len(slopes)), rel=1e-3)


def test_a_branch_over_a_constant_of_a_script_is_that_of_the_study() -> None:
    study_solution = solving.solve(
        Parameters.model_validate(_clamped(branches={"over": "loads.tractions", "to": 1.3}))
    )
    domain = from_geometry(study_solution.parameters.mesh.geometry, MPI.COMM_WORLD, ("bottom",))
    space = fem.functionspace(domain.mesh, ("Lagrange", 1, (2,)))
    pull = fem.Constant(domain.mesh, (0.004, -0.02))
    v = ufl.TestFunction(space)
    held = fem.locate_dofs_geometrical(space, lambda x: np.isclose(x[0], 0.0))
    problem = cl.ContactProblem(
        cl.Elasticity(young=1.0, poisson=0.3),
        ufl.inner(pull, v) * domain.ds(("top",), "top"),
        [fem.dirichletbc(np.zeros(2), held, space)],
        contacts=[
            cl.Contact(
                domain.facets(("bottom",), "on"),
                cl.HalfSpace((0.0, 0.0), (0.0, 1.0)),
                cl.Coulomb(0.3, cl.Convolution(0.3)),
            )
        ],
        n=math.inf,
    )
    found = cl.branch(problem, to=1.3, over=pull)
    problem.close()
    assert tuple(pull.value) == (0.004, -0.02)
    points = study_solution.summary["branches"]["points"]
    assert [point.share for point in found.points] == pytest.approx(points["share"], rel=1e-6)
    assert [point.pressure for point in found.points] == pytest.approx(points["pressure"], rel=1e-4)


def test_a_key_that_is_no_load_is_refused() -> None:
    for key in ("loads.springs", "friction.smoothing.radius", "loads.tractions.1"):
        with pytest.raises(ValueError, match="names no load"):
            Parameters.model_validate(_clamped(branches={"over": key}))


def test_a_branch_over_loads_begins_at_a_solution() -> None:
    data = _clamped(branches={"over": "loads"}, solver={"max_iterations": 1})
    solution = solving.solve(Parameters.model_validate(data))
    assert not solution.converged
    assert "not found" in solution.summary["branches"]["end"]
    assert solution.summary["branches"]["leaves_at"] is None
