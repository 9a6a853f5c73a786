"""Curved cells of degree 2: from files and builders, in all that a study writes, and refusals."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest
from dolfinx import fem
from mpi4py import MPI

import contact_locking as cl
from contact_locking import InputError, StudySolution, solve
from contact_locking.mesh.file.diagnosis import check_curved
from contact_locking.mesh.file.reader import read
from contact_locking.mesh.xdmf_mesh import export
from contact_locking.meshes import write
from contact_locking.meshes.annulus import Annulus
from contact_locking.meshes.round import Ball
from contact_locking.parallel import maximum, on_root
from contact_locking.running import writing
from contact_locking.study.assembly import StudyProblem, assemble, check
from contact_locking.study_file import from_mapping
from contact_locking.study_file.parameters import Parameters

RING = Annulus(h=0.4, quarter=True)
AREA = 0.75 * np.pi
PRESS = 0.01
SIDES = [{"on": "bottom", "value": [None, 0]}, {"on": "left", "value": [0, None]}]


def ring(mesh: dict[str, Any], **changes: Any) -> Parameters:
    """The quarter ring in a rigid ring that presses it."""
    return from_mapping(
        {
            "mesh": mesh,
            "material": {"elasticity": {"young": 1.0, "poisson": 0.3}},
            "loads": {"displacements": SIDES},
            "contact": {
                "on": "outer",
                "foundation": {"expression": f"{2.0 - PRESS} - sqrt(x**2 + y**2)"},
            },
            "discretisation": {"degree": 2},
            "output": {"picture": False},
        }
        | changes
    )


CURVED: dict[str, Any] = {"builder": "annulus", "h": 0.4, "quarter": True, "curved": True}


@pytest.fixture(scope="module")
def solution() -> StudySolution:
    """The ring with a limit that part of it reaches, friction, and probes near its curved side."""
    # 0.1 % of the radius inside of the circle, and outside of the chords.
    point = [1.998 * np.cos(0.07), 1.998 * np.sin(0.07)]
    return solve(
        ring(
            CURVED,
            material={"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.008},
            friction={"coefficient": 0.2},
            output={"picture": False, "probes": [{"points": [point]}], "formats": ["vtx", "xdmf"]},
        )
    )


@pytest.fixture
def file(tmp_path: Path, comm: MPI.Intracomm) -> str:
    """A file of second order with the ring."""
    folder = Path(comm.bcast(str(tmp_path)))
    on_root(comm, lambda: write(RING, folder / "ring.msh", order=2))
    return str(folder / "ring.msh")


def area(problem: StudyProblem) -> float:
    (body,) = [group for group in problem.facts()["groups"] if group.name == "body"]
    return float(body.measure)


def test_a_file_of_second_order_has_curved_cells_for_degree_2(
    file: str, comm: MPI.Intracomm
) -> None:
    problem = assemble(ring({"file": file}), comm)
    assert problem.domain.is_curved
    assert problem.warnings == []
    assert area(problem) == pytest.approx(AREA, rel=2e-5)
    (outer,) = [group for group in problem.facts()["groups"] if group.name == "outer"]
    assert outer.measure == pytest.approx(np.pi, rel=1e-5)
    assert outer.normal == pytest.approx([2.0 / np.pi] * 2, rel=1e-4)
    x = problem.contacts[0].surface.points
    assert np.linalg.norm(x, axis=1) == pytest.approx(2.0, rel=1e-12)
    problem.close()


@pytest.mark.parametrize(
    ("mesh", "degree"), [({}, 1), ({"curved": False}, 2)], ids=["degree 1", "not curved"]
)
def test_a_file_of_second_order_has_straight_cells_otherwise_with_advice_unless_it_was_asked_for(
    mesh: dict[str, Any], degree: int, file: str, comm: MPI.Intracomm
) -> None:
    study = ring({"file": file} | mesh, discretisation={"degree": degree})
    problem = assemble(study, comm)
    assert not problem.domain.is_curved
    told = [text for text in problem.warnings if "corners alone are taken" in text]
    assert len(told) == (0 if mesh else 1)
    problem.close()


def test_the_ring_of_a_file_and_of_the_builder_have_one_pressure(
    file: str, comm: MPI.Intracomm
) -> None:
    meshes: list[dict[str, Any]] = [{"file": file}, CURVED]
    found = [solve(ring(mesh), comm) for mesh in meshes]
    for one in found:
        assert one.converged
        pressure = np.concatenate(comm.allgather(one.contacts[0].pressure))
        assert np.std(pressure) < 0.006 * np.mean(pressure)
    assert found[0].summary["pressure_max"] == pytest.approx(found[1].summary["pressure_max"])


@pytest.mark.serial
@pytest.mark.parametrize("incomplete", [0, 1])
def test_quadrilaterals_of_8_and_9_nodes_have_curved_sides(tmp_path: Path, incomplete: int) -> None:
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
        gmsh.option.setNumber("Mesh.RecombineAll", 1)
        gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 1)
        gmsh.model.occ.addDisk(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [1], name="body")
        gmsh.model.addPhysicalGroup(1, [1], name="rim")
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.write(str(tmp_path / "disc.msh"))
    finally:
        gmsh.finalize()
    rests: dict[str, Any] = {"springs": [{"on": "rim", "stiffness": 1.0}]}
    study = ring({"file": str(tmp_path / "disc.msh")}, contact={"on": "rim"}, loads=rests)
    problem = assemble(study, MPI.COMM_SELF)
    assert problem.domain.is_curved
    assert problem.warnings == []
    assert area(problem) == pytest.approx(np.pi, rel=1e-4)
    x = problem.contacts[0].surface.points
    assert np.linalg.norm(x, axis=1) == pytest.approx(1.0, rel=1e-12)
    problem.close()


@pytest.mark.parametrize(("dim", "cells"), [(2, "simplex"), (2, "box"), (3, "simplex")])
def test_a_constant_strain_is_in_equilibrium(dim: int, cells: str, comm: MPI.Intracomm) -> None:
    builder: dict[str, Any] = {
        "builder": "disc" if dim == 2 else "ball",
        "half": False,
        "quarter": False,
    }
    builder |= {"contact_width": 0.6, "h": 0.5, "curved": True, "cells": cells}
    if dim == 3:
        builder.pop("half")
    slopes = ["0.001*x - 0.002*y", "0.003*x + 0.001*y", "0.002*z + 0.001*x"]
    names = ["contact", "side"] + ["top"] * (dim == 3)
    loads = {"displacements": [{"on": name, "value": slopes[:dim]} for name in names]}
    study = from_mapping(
        {"mesh": builder, "loads": loads, "contact": {"on": []}}
        | {"discretisation": {"degree": 2}, "output": {"picture": False}}
    )
    found = solve(study, comm)
    exact = fem.Function(found.displacement.function_space)
    exact.interpolate(
        lambda x: np.stack(
            [0.001 * x[0] - 0.002 * x[1], 0.003 * x[0] + 0.001 * x[1], 0.002 * x[2] + 0.001 * x[0]]
        )[:dim]
    )
    error = maximum(comm, np.abs(found.displacement.x.array - exact.x.array))
    # The rule of tetrahedra is exact for straight cells only.
    assert error < (1e-12 if dim == 2 else 1e-5)


def test_the_limit_holds_at_the_gauss_points(solution: StudySolution) -> None:
    assert solution.converged
    assert solution.summary["discretisation"] == {"degree": 2, "limit_at": "gauss", "curved": True}
    assert solution.summary["strain_norm_max"] == pytest.approx(0.008, rel=1e-6)
    assert 0.01 < solution.summary["locked_fraction"] < 0.3
    assert 0.0 < solution.summary["overstrain_max"] < 0.3
    assert solution.summary["certificate"]["errors"]["mesh"]["relative"] < 0.1


def test_a_state_is_written_read_and_gone_on_from(
    solution: StudySolution, tmp_path: Path, comm: MPI.Intracomm
) -> None:
    folder = Path(comm.bcast(str(tmp_path)))
    assert writing.write(solution, folder, checkpoint=True) == []
    again = solve(solution.parameters, comm, restart=folder)
    assert again.converged
    assert again.summary["elastic_energy"] == pytest.approx(solution.summary["elastic_energy"])
    if comm.rank == 0:
        assert json.loads((folder / "summary.json").read_text())["discretisation"]["curved"]
        (row,) = np.loadtxt(folder / "probes.csv", delimiter=",", skiprows=1, ndmin=2)
        # The whole rim is pressed by PRESS along the radius.
        assert np.hypot(row[4], row[5]) == pytest.approx(PRESS, rel=2e-3)
        for name in ("fields.bp", "fields.xdmf"):
            assert (folder / name).exists()
    comm.barrier()
    with pytest.raises(InputError, match=r"discretisation\.limit_at: gauss"):
        solve(ring({**CURVED, "curved": False}), comm, restart=folder)


def test_a_penalty_has_its_bounds_and_no_guaranteed_one(comm: MPI.Intracomm) -> None:
    study = ring(
        CURVED,
        material={"elasticity": {"young": 1.0, "poisson": 0.3}, "locking_limit": 0.008},
        penalty={"n": 1e3},
        loads={"displacements": [*SIDES, {"on": "inner", "value": ["-0.004*x", "-0.004*y"]}]},
        certificate={"error_bound": True},
    )
    found = solve(study, comm)
    assert found.converged
    said = found.summary["certificate"]
    for entry in (said["errors"]["guaranteed"], said["limit_load"]):
        assert "cells with straight sides" in entry["reason"]
    assert said["errors"]["penalty"]["relative"] < 0.2


def test_supports_and_pressures_know_the_normals_of_curved_facets(comm: MPI.Intracomm) -> None:
    loads = {
        "displacements": SIDES,
        "supports": [{"on": ["inner"], "along": "normal", "value": -0.001}],
        "pressures": [{"on": "outer", "value": 0.01}],
    }
    found = solve(ring(CURVED, loads=loads, contact={"on": []}), comm)
    x = found.displacement.function_space.tabulate_dof_coordinates()[:, :2]
    inner = np.abs(np.linalg.norm(x, axis=1) - 1.0) < 1e-9
    values = found.displacement.x.array.reshape(-1, 2)
    # The normal out of the body is the one into the hole.
    radial = np.sum(values * x, axis=1)[inner]
    assert radial == pytest.approx(0.001, rel=5e-3)


def test_a_part_of_the_boundary_by_place_has_the_points_of_the_curve(comm: MPI.Intracomm) -> None:
    parts = {"rim": {"expression": "x**2 + y**2 > 3.99999"}}
    problem = assemble(ring({**CURVED, "parts": parts}), comm)
    count = [len(problem.domain.facets((name,))) for name in ("rim", "outer")]
    assert count[0] == count[1]
    problem.close()


def test_a_curved_ball_has_its_volume_and_touches(comm: MPI.Intracomm) -> None:
    study = from_mapping(
        {
            "mesh": {
                **{"builder": "ball", "quarter": True, "curved": True},
                **{"h": 0.5, "h_contact": 0.2, "contact_width": 0.4},
            },
            "loads": {
                "displacements": [
                    {"on": "top", "value": [None, None, -0.02]},
                    {"on": "symmetry_x", "value": [0, None, None]},
                    {"on": "symmetry_y", "value": [None, 0, None]},
                ]
            },
            "contact": {
                "on": "contact",
                "foundation": {"half_space": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
            },
            "discretisation": {"degree": 2},
            "output": {"picture": False},
        }
    )
    problem = assemble(study, comm)
    assert area(problem) == pytest.approx(np.pi / 6.0, rel=1e-3)
    surface = problem.contacts[0].surface
    measure = problem.domain.ds(surface.names, None)
    exact = comm.allreduce(fem.assemble_scalar(fem.form(1.0 * measure)))
    assert surface.integral(np.ones(len(surface.nodes))) == pytest.approx(exact, rel=1e-9)
    problem.close()
    found = solve(study, comm)
    assert found.converged


def test_a_problem_of_python_takes_a_curved_mesh(comm: MPI.Intracomm) -> None:
    study = assemble(ring(CURVED), comm)
    domain = study.domain
    facets = {name: domain.facets((name,)) for name in domain.facet_names}
    rollers = [
        cl.Support(facets["bottom"], (0.0, 1.0), 0.0),
        cl.Support(facets["left"], (1.0, 0.0), 0.0),
    ]

    def problem(degree: int) -> cl.ContactProblem:
        return cl.ContactProblem(
            cl.Elasticity(young=1.0, poisson=0.3),
            None,
            rollers,
            contacts=[cl.Contact(facets["outer"], cl.Gap(-PRESS))],
            space=fem.functionspace(domain.mesh, ("Lagrange", degree, (2,))),
        )

    with pytest.raises(InputError, match="must be 2 in curved cells"):
        problem(1)
    curved = problem(2)
    found, wanted = curved.solve(), solve(ring(CURVED), comm)
    assert found.converged
    energies = [one.summary["elastic_energy"] for one in (found, wanted)]
    # The gap counts along the normals of the body, which are those of the circle but for its ends.
    assert energies[0] == pytest.approx(energies[1], rel=1e-3)
    curved.close()
    study.close()


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"discretisation": {"degree": 1}}, "must be 2 with mesh.curved"),
        ({"discretisation": {"degree": 2, "limit_at": "vertices"}}, "must be gauss in curved"),
        ({"adapt": {"tolerance": 0.1}}, "does not go with mesh.curved"),
        ({"mesh": {"builder": "block", "curved": True}}, "block has straight sides"),
    ],
)
def test_what_does_not_go_with_curved_cells_is_refused(
    changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        check(ring(**({"mesh": CURVED} | changes)), MPI.COMM_SELF)


@pytest.mark.serial
def test_curved_cells_of_xdmf_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "ring.xdmf").touch()
    with pytest.raises(InputError, match="are read from Gmsh files only"):
        ring({"file": str(tmp_path / "ring.xdmf"), "curved": True})
    problem = assemble(ring(CURVED), MPI.COMM_SELF)
    with pytest.raises(InputError, match="write a Gmsh file"):
        export(problem.domain, tmp_path / "out.xdmf")
    problem.close()


@pytest.mark.serial
def test_meshes_of_curved_files_are_not_adapted(tmp_path: Path) -> None:
    write(RING, tmp_path / "ring.msh", order=2)
    study = ring({"file": str(tmp_path / "ring.msh")}, adapt={"tolerance": 0.1})
    with pytest.raises(InputError, match=r"mesh\.curved: false, or leave out adapt"):
        solve(study, MPI.COMM_SELF)


@pytest.mark.serial
def test_bodies_that_touch_each_other_are_refused() -> None:
    study = from_mapping(
        {
            "mesh": {"builder": "disc_in_ring", "h": 0.5, "curved": True},
            "contact": {"on": "rim", "against": "inner"},
            "discretisation": {"degree": 2},
        }
    )
    with pytest.raises(InputError, match="cut into straight pieces"):
        check(study, MPI.COMM_SELF)


@pytest.mark.serial
def test_folded_cells_and_edges_with_two_middles_are_refused(tmp_path: Path) -> None:
    write(RING, tmp_path / "ring.msh", order=2)
    mesh = read(tmp_path / "ring.msh")
    assert mesh.curved is not None
    check_curved(mesh)
    folded = mesh.points.copy()
    inner = mesh.curved[0, 3]
    folded[inner] += 3.0 * (folded[mesh.curved[0, 0]] - folded[inner])
    with pytest.raises(InputError, match="is folded: its curved sides meet"):
        check_curved(_with(mesh, points=folded))
    apart = mesh.curved.copy()
    (owners, places) = np.nonzero(apart[:, 3:] == inner)
    if len(owners) == 1:
        pytest.skip("the edge is on the boundary")
    apart[owners[1], places[1] + 3] = mesh.curved[5, 4]
    with pytest.raises(InputError, match="two nodes in its middle"):
        check_curved(_with(mesh, curved=apart))


def _with(mesh: Any, **changes: Any) -> Any:
    return dataclasses.replace(mesh, **changes)


@pytest.mark.serial
def test_a_curved_file_of_tetrahedra_keeps_its_volume(tmp_path: Path) -> None:
    write(Ball(h=0.5, quarter=True, contact_width=0.6), tmp_path / "ball.msh", order=2)
    mesh = read(tmp_path / "ball.msh")
    assert mesh.curved is not None
    assert mesh.curved.shape[1] == 10
    assert mesh.straightened == pytest.approx(-0.065, abs=0.01)
    assert len(mesh.straight.points) < len(mesh.points)
    check_curved(mesh)
