"""Strains that are not elastic: free and restrained, in sums and regions, energies, limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import rollers_of, solved, with_changes

from contact_locking.parallel import maximum
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

pytestmark = pytest.mark.serial

YOUNG, POISSON, WARM = 2.0, 0.3, 0.004
BODIES = [(2, False), (3, False), (2, True)]


def body(dim: int = 2, axisymmetric: bool = False, **changes: Any) -> Parameters:
    """A block that is free to expand away from its lower left corner, with an eigenstrain."""
    rollers = rollers_of(dim, axisymmetric)
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "dim": dim, "size": [1.0] * dim, "h": 0.5},
        "material": {
            "elasticity": {"young": YOUNG, "poisson": POISSON},
            "eigenstrain": {"value": WARM},
        },
        "loads": {"displacements": rollers},
        "contact": {"on": []},
    }
    if axisymmetric:
        data["mesh"]["axisymmetric"] = True
    return with_changes(data, **changes)


def distance(found: StudySolution, strains: Any) -> float:
    """The largest distance of the displacement from ``x_i e_i``."""
    dim = found.domain.dim
    x = found.displacement.function_space.tabulate_dof_coordinates()[:, :dim]
    u = found.displacement.x.array.reshape(-1, dim)
    return maximum(found.domain.comm, np.abs(u - np.asarray(strains) * x))


def stresses(found: StudySolution) -> Any:
    size = found.elastic_stress.ufl_shape[0]
    return found.elastic_stress.x.array.reshape(-1, size, size)


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize(("dim", "axisymmetric"), BODIES)
def test_a_free_body_expands_without_a_stress(
    dim: int, axisymmetric: bool, degree: int, comm: MPI.Intracomm
) -> None:
    """In plane strain the plane is held across: ``(1 + nu) e`` in it, and ``-E e`` across."""
    found = solved(body(dim, axisymmetric, discretisation__degree=degree), comm)
    across = dim == 2 and not axisymmetric
    wide = (1.0 + POISSON) * WARM if across else WARM
    assert distance(found, wide) < 1e-12
    assert maximum(comm, np.abs(stresses(found))) < 1e-12
    summary = found.summary
    assert summary["von_mises_max"] == pytest.approx(YOUNG * WARM * across, abs=1e-12)
    assert summary["elastic_energy"] == pytest.approx(0.5 * YOUNG * WARM**2 * across, abs=1e-15)
    assert summary["compliance"] == pytest.approx(0.0, abs=1e-15)


def test_a_shear_strain_is_free_where_nothing_holds_it_back(comm: MPI.Intracomm) -> None:
    """``u = (2 g y, 0)`` has the strain ``g`` that the eigenstrain asks for."""
    shear = 0.003
    given = {"value": [[0.0, shear], [shear, 0.0]]}
    held = [
        {"on": "bottom", "value": [0.0, 0.0]},
        {"on": "top", "value": [2.0 * shear, 0.0]},
        {"on": "left", "value": [f"{2.0 * shear}*y", 0.0]},
    ]
    found = solved(body(material__eigenstrain=given, loads__displacements=held), comm)
    assert maximum(comm, np.abs(stresses(found))) < 1e-12


def test_a_strain_on_a_region_is_that_of_an_expression(comm: MPI.Intracomm) -> None:
    mesh = {"builder": "inclusion", "h": 0.2}
    inside = solved(body(mesh=mesh, material__eigenstrain={"value": WARM, "on": "inclusion"}), comm)
    there = f"{WARM} if (x - 0.5)**2 + (y - 0.5)**2 < 0.0625 else 0"
    told = solved(body(mesh=mesh, material__eigenstrain={"value": there}), comm)
    apart = np.abs(inside.displacement.x.array - told.displacement.x.array)
    assert maximum(comm, apart) < 1e-14
    # The mesh follows the circle with chords, which the expression does not.
    about = [(finding.code, finding.key) for finding in told.warnings]
    assert about == [("data.features", "material.eigenstrain.value")]
    assert not inside.summary["warnings"]
    both = {"value": WARM, "on": ["body", "inclusion"]}
    whole = solved(body(mesh=mesh, material__eigenstrain=both), comm)
    assert distance(whole, (1.0 + POISSON) * WARM) < 1e-12


def test_steps_heat_and_load_with_a_balance_of_energies(comm: MPI.Intracomm) -> None:
    """Heat without restraint stores nothing; with a load on the top it lifts the load."""
    steps = {"to": 2.0, "count": 4}
    warm = {"expansion": WARM, "temperature": "min(t, 1)"}
    free = solved(body(3, material__eigenstrain=warm, steps=steps), comm)
    for row in free.history.rows:
        for key in ("stored", "work", "numerical", "elastic_energy"):
            assert row[key] == pytest.approx(0.0, abs=1e-15), key
        assert row["energy_defect"] < 1e-8
    push = 0.01
    tractions = [{"on": "top", "value": [0.0, 0.0, "-0.01*min(t, 1)"]}]
    later = {"expansion": WARM, "temperature": "max(t - 1, 0)"}
    loaded = solved(
        body(3, material__eigenstrain=later, loads__tractions=tractions, steps=steps), comm
    )
    pressed, lifted = loaded.history.rows[1], loaded.history.rows[3]
    stored = 0.5 * push**2 / YOUNG
    assert pressed["stored"] == pytest.approx(stored, rel=1e-8)
    # The heat does the work that lifts the load, and the body stores what it had stored.
    assert lifted["stored"] == pytest.approx(stored, rel=1e-8)
    assert lifted["work"] == pytest.approx(0.0, abs=1e-12)
    assert lifted["compliance"] == pytest.approx(push**2 / YOUNG - push * WARM, rel=1e-8)
    assert abs(lifted["numerical"]) < 1e-12
