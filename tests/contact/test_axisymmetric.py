"""Axisymmetric bodies: what is refused, the nodes on the axis, and R on the whole surface."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import with_changes

from contact_locking.errors import InputError
from contact_locking.running import solving
from contact_locking.running.assembly import StudyProblem, assemble
from contact_locking.study_file.parameters import Parameters


def cylinder(**changes: Any) -> Parameters:
    """A cylinder of radius and height 1 under its own weight on a foundation with friction."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "size": [1.0, 1.0], "h": 0.25, "axisymmetric": True},
        "material": {"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.05},
        "loads": {"body_force": [0.0, -0.1]},
        "contact": {"on": "bottom", "gap": "0.02*x*x"},
        "friction": {"coefficient": 0.3, "smoothing": {"radius": 0.3}},
    }
    return with_changes(data, **changes)


def on_foundation(degree: int = 1, **changes: Any) -> StudyProblem:
    study = cylinder(discretisation={"degree": degree}, **changes)
    return assemble(study, MPI.COMM_WORLD)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"contact__on": ["bottom", "left"]}, "contact.on"),
        ({"loads__pressures": [{"on": "left", "value": 1.0}]}, "loads.pressures.0.on"),
        (
            {"loads__displacements": [{"on": "top", "value": ["0.1 + x", None]}]},
            "loads.displacements.0.value.0",
        ),
        ({"loads__body_force": [0.0, 0.1]}, "loads.displacements"),
    ],
)
def test_what_contradicts_the_axis_is_refused_with_its_key(
    changes: dict[str, Any], key: str
) -> None:
    with pytest.raises(InputError) as caught:
        assemble(cylinder(**changes), MPI.COMM_WORLD)
    assert caught.value.key == key


@pytest.mark.serial
def test_a_mesh_on_both_sides_of_the_axis_is_refused() -> None:
    from contact_locking.running.assembly import mesh_of

    domain = mesh_of(cylinder(), MPI.COMM_WORLD)
    domain.mesh.geometry.x[:, 0] -= 0.5
    with pytest.raises(InputError, match=r"reaches x = -0.5") as caught:
        assemble(cylinder(), MPI.COMM_WORLD, domain)
    assert caught.value.key == "mesh.axisymmetric"


@pytest.mark.serial
@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_weights_of_gamma_c_add_up_to_the_surface_and_are_positive_on_the_axis(degree: int) -> None:
    problem = on_foundation(degree)
    (contact,) = problem.contacts
    surface, comm = contact.surface, problem.domain.comm
    assert (surface.weights > 0.0).all()
    radius = surface.points[:, 0]
    assert comm.allreduce(int(np.sum(radius == 0.0))) == 1
    assert comm.allreduce(float(surface.weights.sum())) == pytest.approx(math.pi, rel=1e-12)
    # The trapezoid rule would give less: 2 pi r dr at the nodes.
    assert comm.allreduce(float(surface.weights @ radius)) == pytest.approx(
        2.0 / 3.0 * math.pi, rel=0.05
    )
    assert contact.normals[radius == 0.0].sum(axis=0) == pytest.approx(
        [0.0, -np.sum(radius == 0.0)]
    )
    # The displacement condition of the axis, and no other one.
    fixed = problem.constraints.dofs
    x = problem.u.function_space.tabulate_dof_coordinates()
    assert x[fixed // 2, 0] == pytest.approx(0.0, abs=1e-12)
    assert (fixed % 2 == 0).all()
    problem.close()


@pytest.mark.parametrize("kernel", ["convolution", "helmholtz"])
def test_r_keeps_constants_and_smooths_over_the_whole_surface(kernel: str) -> None:
    smoothing = {"kernel": kernel, "radius": 0.3}
    problem = on_foundation(friction__smoothing=smoothing, mesh__h=0.05, mesh__structured=True)
    (contact,), comm = problem.contacts, problem.domain.comm
    apply, radius = contact.friction.smoothing.apply, contact.surface.points[:, 0]
    assert apply(np.full(len(radius), 3.0)) == pytest.approx(3.0, rel=1e-12)
    # On a disc the mean of |y|^2 over the kernel is |x|^2 + c, c being the mean around the origin.
    smoothed = apply(radius**2)
    if kernel == "convolution":
        inside, added = radius < 0.65, 0.3**2 * _second_moment()
        assert smoothed[inside] == pytest.approx(radius[inside] ** 2 + added, abs=2e-3)
        assert comm.allreduce(int(inside.sum())) > 10
    else:
        # The filter keeps the mean over the surface.
        weights = contact.surface.weights
        means = [comm.allreduce(float(weights @ w)) / math.pi for w in (smoothed, radius**2)]
        assert means[0] == pytest.approx(means[1], rel=1e-10)
    problem.close()


def _second_moment() -> float:
    """``int d^2 k(d) / int k(d)`` over the unit disc."""
    d = (np.arange(2000) + 0.5) / 2000.0
    kernel = np.exp(-1.0 / (1.0 - d**2)) * d
    return float(d**2 @ kernel / kernel.sum())


def test_the_certificate_holds_for_a_body_of_revolution_that_locks_and_rubs() -> None:
    solution = solving.solve(cylinder())
    summary = solution.summary
    assert summary["converged"], summary["reason"]
    assert summary["locked_fraction"] > 0.0
    assert summary["discretisation"]["axisymmetric"] is True
    certificate = summary["certificate"]
    assert all(entry["holds"] for entry in certificate["criteria"].values())
    assert all(entry["bound"] is None for entry in certificate["bounds"].values())
    assert certificate["resultants"]["loads"][1] == pytest.approx(-0.1 * math.pi, rel=1e-12)
    assert certificate["resultants"]["contact"][1] == pytest.approx(0.1 * math.pi, rel=1e-7)
    if MPI.COMM_WORLD.size > 1:
        alone = solving.solve(cylinder(), MPI.COMM_SELF).summary
        assert summary["elastic_energy"] == pytest.approx(alone["elastic_energy"], rel=1e-8)
    assert solution.elastic_stress.ufl_shape == (3, 3)
