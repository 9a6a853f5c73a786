"""Springs on the boundary, whose forces are reactions, and total forces on its parts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block, solved, with_changes
from slow import slow

from contact_locking import InputError, from_mapping, solve
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

YOUNG, STIFFNESS, PUSH = 2.0, 0.5, 0.01


def pillar(dim: int = 2, axisymmetric: bool = False, **changes: Any) -> Parameters:
    """A block on springs alone, without a lateral strain, with a pressure on its top."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": 0.5},
        "material": {"elasticity": {"young": YOUNG, "poisson": 0.0}},
        "loads": {
            "pressures": [{"on": "top", "value": PUSH}],
            "springs": [{"on": "bottom", "stiffness": STIFFNESS}],
        },
        "contact": {"on": []},
    }
    if axisymmetric:
        data["mesh"]["axisymmetric"] = True
    return with_changes(data, **changes)


@pytest.mark.parametrize("degree", [1, slow(2)])
@pytest.mark.parametrize(("dim", "axisymmetric"), [(2, False), (3, False), (2, True)])
def test_springs_alone_hold_the_body(
    dim: int, axisymmetric: bool, degree: int, comm: MPI.Intracomm
) -> None:
    found = solved(pillar(dim, axisymmetric, discretisation__degree=degree), comm)
    area = math.pi if axisymmetric else 1.0
    summary = found.summary
    sinks = PUSH / STIFFNESS + PUSH / YOUNG
    assert summary["displacement_max"] == pytest.approx(sinks, rel=1e-8)
    assert summary["compliance"] == pytest.approx(PUSH * sinks * area, rel=1e-8)
    assert summary["elastic_energy"] == pytest.approx(0.5 * PUSH * sinks * area, rel=1e-8)
    assert summary["reactions"]["bottom"][-1] == pytest.approx(PUSH * area, rel=1e-8)
    assert summary["certificate"]["resultants"]["reactions"][-1] == pytest.approx(PUSH * area)
    for entry in summary["bounds"].values():
        assert entry["bound"] is None and "conditions alone do not hold" in entry["reason"]
    assert summary["certificate"]["constants"]["uniqueness"]["verdict"] == "covered by theory"


def test_a_stiff_body_tilts_on_its_bed(comm: MPI.Intracomm) -> None:
    """``u_y = -F/(k L) - (M/(k L^3/12)) (x - L/2)`` for a force at the right end."""
    loads = {
        "tractions": [{"on": "top", "value": [0.0, "-0.02*x"]}],
        "springs": [{"on": "bottom", "stiffness": STIFFNESS, "along": "normal"}],
        "supports": [{"on": "right", "along": [1, 0]}],
    }
    held = {"springs": loads["springs"], "tractions": loads["tractions"]}
    held["displacements"] = [{"on": "bottom", "value": [0.0, None]}]
    found = solved(pillar(loads=held, material__elasticity__young=1e7), comm)
    force, moment = 0.01, 0.02 / 3.0 - 0.005
    x = found.displacement.function_space.tabulate_dof_coordinates()
    bottom = x[:, 1] < 1e-9
    wanted = -force / STIFFNESS - 12.0 * moment / STIFFNESS * (x[:, 0] - 0.5)
    u = found.displacement.x.array.reshape(-1, 2)
    assert np.allclose(u[bottom, 1], wanted[bottom], rtol=1e-4)
    with pytest.raises(InputError, match="leave a rigid motion free"):
        solve(pillar(loads=loads | {"supports": []}), comm)


def test_a_stiffness_may_vary_and_must_be_positive(comm: MPI.Intracomm) -> None:
    bed: dict[str, Any] = {"on": "bottom", "stiffness": "0.4 + 0.2*x", "along": [0.0, 2.0]}
    sides = [{"on": ["left", "right"], "value": [0.0, None]}]
    given: dict[str, Any] = {"loads__springs": [bed], "material__elasticity__young": 1e7}
    found = solved(pillar(**given, loads__displacements=sides), comm)
    assert found.summary["reactions"]["bottom"][1] == pytest.approx(PUSH, rel=1e-6)
    with pytest.raises(InputError, match="must be positive everywhere"):
        solve(pillar(loads__springs=[bed | {"stiffness": "x - 0.5"}]), comm)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_force_is_the_traction_with_this_resultant(dim: int, comm: MPI.Intracomm) -> None:
    size = [1.0, 0.5, 0.8] if dim == 3 else [2.0, 1.0]
    area = 0.5 if dim == 3 else 2.0
    pull = [0.01, 0.0, -0.02] if dim == 3 else [0.01, -0.02]
    held = [{"on": "left", "value": [0.0] * dim}]
    given: dict[str, Any] = {"mesh__size": size, "mesh__structured": True}
    by_traction = {"tractions": [{"on": "top", "value": pull}], "displacements": held}
    force = [area * value for value in pull]
    by_force = {"forces": [{"on": "top", "value": force}], "displacements": held}
    one = solve(block(dim, 0.25, loads=by_traction, **given), comm)
    other = solve(block(dim, 0.25, loads=by_force, **given), comm)
    for key in ("compliance", "contact_force", "friction_force"):
        assert other.summary[key] == pytest.approx(one.summary[key], rel=1e-8)


def test_a_force_on_a_body_of_revolution_is_that_of_the_whole_ring(comm: MPI.Intracomm) -> None:
    loads = {"forces": [{"on": "top", "value": [0.0, -0.1]}]}
    mesh = {"builder": "block", "size": [0.7, 1.0], "h": 0.35, "axisymmetric": True}
    given = {"mesh": mesh, "loads": loads, "contact": {"on": "bottom"}, "penalty": {"n": math.inf}}
    found = solve(from_mapping(given | {"friction": {"coefficient": 0.0}}), comm)
    assert found.summary["contact_force"][1] == pytest.approx(0.1, rel=1e-6)
    shortening = 0.1 / (math.pi * 0.7**2)
    assert found.summary["compliance"] == pytest.approx(0.1 * shortening, rel=1e-6)


def test_a_force_in_space_and_a_radial_force_are_refused(comm: MPI.Intracomm) -> None:
    with pytest.raises(InputError, match=r"loads\.forces\.0\.value\.1: .*unknown name 'x'"):
        from_mapping({"loads": {"forces": [{"on": "top", "value": [0, "x"]}]}})
    mesh = {"builder": "block", "axisymmetric": True}
    with pytest.raises(InputError, match=r"loads\.forces\.0\.value\.0: .*along the axis"):
        from_mapping({"mesh": mesh, "loads": {"forces": [{"on": "top", "value": [1, 0]}]}})
