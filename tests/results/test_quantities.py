"""The quantities of the summary: closed forms of the first numbers, and one of a script's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import generated_reference
import numpy as np
import pytest
from mpi4py import MPI
from problems import block, column, sheared, solved, with_changes
from report_folder import quick

from contact_locking import solve
from contact_locking.laws.body import lame_from_young
from contact_locking.results import in_words
from contact_locking.results.quantities import QUANTITIES, quantity, touches
from contact_locking.running.run import run
from contact_locking.study_file.parameters import Parameters
from contact_locking.view import report
from contact_locking.view.report.folders import read_all

PRESSURE, YOUNG, POISSON = 0.01, 2.0, 0.3


def pressed(dim: int = 2, **changes: Any) -> Parameters:
    """A block on a plane without friction, free to widen from x = 0 and y = 0 on: uniaxial."""
    rollers: list[dict[str, Any]] = [{"on": "left", "value": [0.0, *[None] * (dim - 1)]}]
    if dim == 3:
        rollers.append({"on": "front", "value": [None, 0.0, None]})
    down = [*[0.0] * (dim - 1), -PRESSURE]
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": 0.5},
        "material": {"elasticity": {"young": YOUNG, "poisson": POISSON}},
        "loads": {"tractions": [{"on": "top", "value": down}], "displacements": rollers},
        "contact": {"on": "bottom"},
    }
    return with_changes(data, **changes)


def summary(parameters: Parameters) -> Mapping[str, Any]:
    found = solved(parameters)
    return found.summary


BODIES: dict[str, tuple[dict[str, Any], float, list[float]]] = {
    # The von Mises stress over the pressure, and the strains.
    "plane strain": (
        {},
        (1.0 - POISSON + POISSON**2) ** 0.5,
        [POISSON * (1.0 + POISSON), POISSON**2 - 1.0],
    ),
    "plane stress": ({"material__plane": "stress"}, 1.0, [POISSON, -1.0]),
    "3D": ({"dim": 3}, 1.0, [POISSON, POISSON, -1.0]),
    "axisymmetric": (
        {"mesh__axisymmetric": True, "loads__displacements": []},
        1.0,
        [POISSON, -1.0],
    ),
    "degree 2": ({"dim": 3, "discretisation__degree": 2}, 1.0, [POISSON, POISSON, -1.0]),
}


@pytest.mark.serial
@pytest.mark.parametrize("name", BODIES)
def test_a_pressed_block_has_the_numbers_of_uniaxial_stress(name: str) -> None:
    changes, stress, strains = BODIES[name]
    found = summary(pressed(**changes))
    corner = [1.0] * len(strains)
    assert found["von_mises_max"] == pytest.approx(stress * PRESSURE, rel=1e-7)
    size = np.linalg.norm(strains) * PRESSURE / YOUNG
    assert found["displacement_max"] == pytest.approx(size, rel=1e-6)
    assert found["displacement_max_at"] == pytest.approx(corner)
    assert found["pressure_max"] == pytest.approx(PRESSURE, rel=1e-6)
    assert found["pressure_max_at"] == pytest.approx([0.0] * len(strains), abs=1e-12)
    assert np.abs(found["contact_moment"]).max() <= 1e-7 * PRESSURE
    assert found["friction_used"] is None and found["limit_used"] is None


@pytest.mark.serial
def test_the_locking_stress_is_part_of_the_von_mises_stress() -> None:
    """In uniaxial strain the sides bear ``lambda M``, and the limit takes the rest of the load."""
    found = summary(column(2, 0.05, penalty__n=float("inf")))
    lame_lambda = lame_from_young(1.0, 0.3)[0]
    assert found["von_mises_max"] == pytest.approx(0.05 - 0.02 * lame_lambda, rel=1e-5)
    assert found["limit_used"] == pytest.approx(1.0, abs=1e-8)


@pytest.mark.serial
def test_a_strain_beyond_the_limit_between_the_points_that_keep_it_is_told() -> None:
    cells: dict[str, Any] = {"mesh__cells": "box", "mesh__structured": True}
    found = summary(block(h=0.25, penalty__n=float("inf"), **cells))
    assert found["limit_used"] == pytest.approx(1.0, abs=1e-8)
    assert found["overstrain_max"] > 0.3
    assert any("132 % of its limit between the points" in text for text in found["warnings"])


@pytest.mark.serial
@pytest.mark.parametrize(
    "material",
    [
        {"elasticity": {"stiffness": [[3.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]}},
        {"locking": [{"norm": "volume", "at_least": -0.1}]},
    ],
)
def test_the_von_mises_stress_is_not_known_without_the_stress_across_the_plane(
    material: dict[str, Any],
) -> None:
    found = solve(pressed(material=material))
    assert found.converged and found.von_mises is None
    assert found.summary["von_mises_max"] is found.summary["von_mises_max_at"] is None


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
def test_friction_balances_the_moment_of_a_shear_on_the_top(dim: int) -> None:
    """A traction ``t`` on the top of height 1, and in 3D a twist ``c (-y, x)`` about its middle."""
    shear, twist = 0.02, 0.1
    push: list[Any] = [shear, -1.0]
    if dim == 3:
        push = [f"{twist}*(0.5 - y)", f"{twist}*(x - 0.5)", -1.0]
    found = summary(
        pressed(
            dim,
            loads={"tractions": [{"on": "top", "value": push}]},
            friction={"coefficient": 0.5, "smoothing": {"kernel": "none"}},
        )
    )
    # The polar moment of the unit square is 1/6; the mesh has the exact one.
    wanted = shear if dim == 2 else [0.0, 0.0, -twist / 6.0]
    assert found["contact_area"] == pytest.approx(1.0)
    assert found["contact_moment"] == pytest.approx(wanted, abs=1e-7)
    assert found["contact_moment_at"] == pytest.approx([*[0.5] * (dim - 1), 0.0], abs=1e-9)
    if dim == 2:
        # All tractions of friction point to the left, and friction could hold half of the load.
        assert found["friction_force"][0] == pytest.approx(-shear, rel=1e-6)


@pytest.mark.serial
@pytest.mark.parametrize("dim", [2, 3])
def test_the_centre_of_pressure_is_below_the_resultant_of_the_load(dim: int) -> None:
    """A pressure ``1 + x - 1/2`` on the top of a unit block has its resultant at x = 7/12."""
    push = [*[0.0] * (dim - 1), "-0.01*(0.5 + x)"]
    found = summary(
        pressed(
            dim,
            loads={"tractions": [{"on": "top", "value": push}]},
            friction={"coefficient": 0.5, "smoothing": {"kernel": "none"}},
        )
    )
    wanted = [7 / 12, *[0.5] * (dim - 2), 0.0]
    assert found["pressure_centre"] == pytest.approx(wanted, abs=1e-6)


@quick
@pytest.mark.serial
def test_the_centre_of_pressure_is_not_known_before_the_body_touches(tmp_path: Path) -> None:
    down = {"displacements": [{"on": "top", "value": [0.0, "-0.05*t"]}]}
    steps, output = {"times": [0.5, 1.0]}, {"directory": "r", "picture": False, "fields": False}
    touching = {"on": "bottom", "gap": 0.03}
    given = pressed(contact=touching, loads=down, steps=steps, output=output)
    solution, _ = run(given, tmp_path)
    assert solution.summary["pressure_centre"] == pytest.approx([0.5, 0.0], abs=1e-3)
    (results,) = read_all(tmp_path)
    history = results.history  # type: ignore[union-attr]
    assert np.isnan(history.column("pressure_centre_x")).tolist() == [True, False]
    assert history.column("pressure_centre_y")[1] == 0.0
    page = report.write(tmp_path)[-1].read_text(encoding="utf-8")
    assert '<span title="pressure_centre">centre of pressure</span>' in page
    assert (tmp_path / "report" / "history-place.svg").exists()


def test_the_numbers_and_their_places_do_not_depend_on_the_ranks() -> None:
    given = block(h=0.25, penalty__n=float("inf"), material__locking_limit=0.02)
    together, alone = summary(given), solve(given, MPI.COMM_SELF).summary
    for key, item in QUANTITIES.items():
        if item.compute is not None and not key.startswith("slip"):
            assert together[key] == pytest.approx(alone[key], rel=1e-5, abs=1e-7), key
            if item.at:
                assert together[f"{key}_at"] == pytest.approx(alone[f"{key}_at"], abs=1e-9), key


@pytest.fixture
def own() -> Iterator[str]:
    @quantity("contact", "mean pressure", "stress")
    def pressure_mean(contacts: Any) -> Any:
        """Mean pressure where the body touches."""
        return contacts.integral(lambda one: one.pressure) / (contacts.integral(touches) or 1.0)

    yield "pressure_mean"
    del QUANTITIES["pressure_mean"]


@pytest.mark.slow
@pytest.mark.serial
def test_a_quantity_of_five_lines_is_everywhere(own: str, tmp_path: Path) -> None:
    parameters = sheared(2, output={"directory": "r", "picture": False, "fields": False})
    solution, _ = run(parameters, tmp_path)
    mean = solution.summary[own]
    assert mean == pytest.approx(solution.summary["contact_force"][1], rel=1e-6) and mean > 0.0
    assert solution.history.column(own)[-1] == mean
    assert dict(in_words.rows(solution.summary))["mean pressure"] == f"{mean:.4g}"
    (results,) = read_all(tmp_path)
    assert results.summary[own] == mean  # type: ignore[union-attr]
    page = report.write(tmp_path)[-1].read_text(encoding="utf-8")
    assert f'<span title="{own}">mean pressure</span>' in page
    assert "mean pressure where the body touches" in page
    drawing = (tmp_path / "report" / "history-stress.svg").read_text()
    assert "<!-- mean pressure -->" in drawing
    reference = generated_reference.fill(generated_reference.CONTACTS)
    assert f"| `{own}` | stress | mean pressure where the body touches |" in reference
