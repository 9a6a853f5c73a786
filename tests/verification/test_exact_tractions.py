"""Tractions on Gamma_C that closed forms know, and tractions in files that balance the loads."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sweep.case import Study, clamp, study

from contact_locking import from_mapping, solve
from contact_locking.command import cli
from contact_locking.results.solution import StudySolution

pytestmark = pytest.mark.serial

PRESSURE = 0.02


def sheared(dim: int, shear: float, kernel: str, **friction: Any) -> Study:
    """A block under the uniform stress of a pressure and a shear, held by friction alone.

    Without a lateral contraction the foot has no strain.
    """
    rest = [0.0] * (dim - 2)
    loads = {
        "tractions": [
            {"on": "top", "value": [shear, *rest, -PRESSURE]},
            {"on": "right", "value": [0.0, *rest, shear]},
            {"on": "left", "value": [0.0, *rest, -shear]},
        ]
    }
    mesh = {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": 0.34}
    smoothing: Study = {"kernel": kernel} if kernel == "none" else {"kernel": kernel, "radius": 0.5}
    data = study(mesh, loads, poisson=0.0, smoothing=smoothing)
    data["friction"] |= friction
    return data


def solved(data: Study) -> StudySolution:
    solution = solve(from_mapping(data))
    assert solution.converged, solution.summary["reason"]
    return solution


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", ["convolution", "helmholtz", "none"])
def test_regularised_friction_slips_as_far_as_it_needs_to(dim: int, kernel: str) -> None:
    """(22) with t = mu p s/sqrt(s^2 + delta^2): ``s = delta t/sqrt(mu^2 p^2 - t^2)``."""
    mu, shear, delta = 0.5, 0.006, 1e-3
    found = solved(sheared(dim, shear, kernel, coefficient=mu, regularisation=delta))
    points = found.contact_points
    assert points is not None
    slip = delta * shear / math.sqrt((mu * PRESSURE) ** 2 - shear**2)
    expected = np.zeros_like(points.u_tangent)
    expected[:, 0] = slip
    # A duality gap of 1e-8, at which the solver stops, allows 1e-4.
    np.testing.assert_allclose(points.u_tangent, expected, atol=1e-5 * slip)
    np.testing.assert_allclose(points.pressure, PRESSURE, rtol=1e-6)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", ["convolution", "helmholtz", "none"])
def test_coulombs_friction_holds_without_any_slip(dim: int, kernel: str) -> None:
    found = solved(sheared(dim, 0.006, kernel, coefficient=0.5, regularisation=0.0))
    points = found.contact_points
    assert points is not None
    assert np.abs(points.u_tangent).max() <= 1e-6 * np.abs(found.displacement.x.array).max()


@pytest.mark.parametrize("penalty", [{"n": math.inf}, {"n": 1e3, "epsilon": 1e-3}])
def test_the_rows_of_contact_csv_balance_loads_and_reactions(
    penalty: Study, tmp_path: Path
) -> None:
    """By the rule of the rows: the foot is straight, and its nodes have the trapezoids' weights."""
    loads = {
        "tractions": [{"on": "top", "value": [0.03, -0.05]}],
        "displacements": [clamp(2)],
    }
    mesh = {"builder": "block", "h": 0.2}
    data = study(mesh, loads, limit=0.02, gap="0.01*(1 - x)", friction=0.3, penalty=penalty)
    data["output"] = {"picture": False}
    study_file = tmp_path / "study.yml"
    study_file.write_text(json.dumps(data).replace("Infinity", ".inf"))
    assert cli.main(["run", str(study_file), "--quiet", "--output", str(tmp_path / "out")]) == 0
    with (tmp_path / "out" / "contact.csv").open() as stream:
        rows = sorted(csv.DictReader(stream), key=lambda row: float(row["x"]))
    table = {
        name: np.array([float(row[name]) for row in rows])
        for name in ("x", "pressure", "traction_tangent_x")
    }
    assert min(table["pressure"]) == 0.0 < max(table["pressure"])
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    held = np.array(summary["reactions"]["left"])
    pressed = np.trapezoid(table["pressure"], table["x"])
    rubbed = np.trapezoid(table["traction_tangent_x"], table["x"])
    balance = held + np.array([rubbed + 0.03, pressed - 0.05])
    np.testing.assert_allclose(balance, 0.0, atol=1e-9)
