"""Total forces on parts of the boundary: spread evenly, over time, in every kind of body."""

from __future__ import annotations

import math
from typing import Any

import pytest
from mpi4py import MPI
from problems import block

from contact_locking import InputError, from_mapping, solve

pytestmark = pytest.mark.serial


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
