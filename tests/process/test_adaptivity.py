"""The loop of adapted meshes: its end, its tolerance, its independence of ranks, its restart."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from dolfinx.mesh import compute_midpoints, meshtags
from mpi4py import MPI
from problems import block

import contact_locking as cl
from contact_locking import assemble, save, solve, solve_adaptively, write
from contact_locking.errors import InputError
from contact_locking.fem.compiled import integral
from contact_locking.process import adaptive_meshes
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters
from contact_locking.view import report

LIMITLESS: dict[str, Any] = {
    "penalty__n": float("inf"),
    "friction__smoothing": {"kernel": "convolution"},
}


def adaptive(dim: int = 2, h: float = 0.25, adapt: Any = None, **changes: Any) -> Parameters:
    return block(dim, h, **{**LIMITLESS, "adapt": adapt or {"tolerance": 0.1}, **changes})


def meshes(solution: cl.Solution) -> list[dict[str, Any]]:
    return list(solution.summary["adapt"]["meshes"])


@pytest.mark.serial
def test_loop_ends_below_the_tolerance_with_fewer_unknowns_than_a_uniform_mesh() -> None:
    given = adaptive(material__locking_limit=float("inf"), adapt={"tolerance": 0.08})
    solutions = list(solve_adaptively(given))
    last = solutions[-1].summary["adapt"]
    assert last["reached"] and last["stopped"] == "the estimate is below the tolerance"
    assert [len(meshes(solution)) for solution in solutions] == list(range(1, len(solutions) + 1))
    estimates = [entry["estimate"] for entry in last["meshes"]]
    assert estimates[-1] <= 0.08 < min(estimates[:-1])
    assert all(solution.converged for solution in solutions)
    # A uniform mesh with more unknowns has a larger error.
    uniform = solving.solve(adaptive(h=0.045, material__locking_limit=float("inf")))
    assert uniform.summary["dofs"] > solutions[-1].summary["dofs"]
    assert uniform.summary["certificate"]["errors"]["mesh"]["relative"] > 1.1 * estimates[-1]


@pytest.mark.serial
def test_default_radius_of_smoothing_is_that_of_the_first_mesh() -> None:
    solutions = list(solve_adaptively(adaptive(h=0.34, adapt={"tolerance": 0.13})))
    first, last = (solution.domain for solution in (solutions[0], solutions[-1]))
    assert not first.is_refined and last.is_refined
    # Two facets of the first mesh, which are longer than a tenth of the contact boundary.
    assert last.smoothing_radii == {"contact": pytest.approx(2.0 / 3.0)}
    contact = last.facets(("bottom",))
    assert last.facet_diameter(contact) < first.facet_diameter(first.facets(("bottom",)))
    force = [solution.summary["contact_force"] for solution in solutions[-2:]]
    assert force[1] == pytest.approx(force[0], rel=0.05, abs=1e-4)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("adapt", "told"),
    [
        ({"tolerance": 0.01, "max_meshes": 2}, "adapt.max_meshes, 2,"),
        ({"tolerance": 0.01, "max_dofs": 100}, "more than adapt.max_dofs"),
    ],
)
def test_an_early_end_is_said_in_the_summary_and_in_a_warning(
    adapt: dict[str, Any], told: str
) -> None:
    solution = solve(adaptive(adapt=adapt))
    found = solution.summary["adapt"]
    assert not found["reached"] and told in found["stopped"]
    reasons = [x.numbers["reason"] for x in solution.warnings if x.code == "adapt.stopped"]
    assert reasons == [found["stopped"]]
    assert solution.converged and solution.summary["dofs"] <= adapt.get("max_dofs", 10**6)


def test_meshes_do_not_depend_on_the_ranks(comm: MPI.Intracomm) -> None:
    given = adaptive(adapt={"tolerance": 0.01, "max_meshes": 3})
    alone, together = solve(given, MPI.COMM_SELF), solve(given, comm)
    assert [m["dofs"] for m in meshes(alone)] == [m["dofs"] for m in meshes(together)]
    for one, other in zip(meshes(alone), meshes(together), strict=True):
        assert one["estimate"] == pytest.approx(other["estimate"], rel=1e-6)
    keys = ("compliance", "elastic_energy", "contact_area")
    assert [alone.summary[key] for key in keys] == pytest.approx(
        [together.summary[key] for key in keys], rel=1e-7
    )
    # The cells of the last mesh are spread over all ranks.
    owned = together.domain.mesh.topology.index_map(2).size_local
    assert max(comm.allgather(owned)) < 1.3 * together.domain.num_cells / comm.size


def test_loop_goes_on_from_the_checkpoint_of_its_last_mesh(
    comm: MPI.Intracomm, tmp_path: Path
) -> None:
    folder = comm.bcast(tmp_path)
    two, three = ({"tolerance": 0.01, "max_meshes": number} for number in (2, 3))
    first = solve(adaptive(h=0.5, adapt=two), comm)
    save(first, folder)
    again = solve(adaptive(h=0.5, adapt=two), comm, restart=folder)
    assert meshes(again)[0]["tangents"] == 0
    assert meshes(again)[0]["dofs"] == first.summary["dofs"]
    whole = solve(adaptive(h=0.5, adapt=three), comm)
    assert [m["dofs"] for m in meshes(whole)][-len(meshes(again)) :] == [
        m["dofs"] for m in meshes(again)
    ]
    with pytest.raises(InputError, match=r"of another mesh.*refined"):
        list(solving.solve_steps(block(h=0.5, **LIMITLESS), comm, restart=folder))


def test_the_mesh_is_refined_where_a_tool_enters_between_the_nodes() -> None:
    """On the first mesh the tool meets no node, and the body is at rest."""
    data = {
        "mesh": {"builder": "block", "size": [10, 3], "h": 1.0, "structured": True},
        "material": {"elasticity": {"young": 5.0, "poisson": 0.3}},
        "loads": {"displacements": [{"on": "bottom", "value": [0, 0]}]},
        "contact": {
            "on": "top",
            "foundation": {"cylinder": {"centre": [5.5, 3.28], "radius": 0.3}},
        },
        "adapt": {"tolerance": 0.4, "max_meshes": 20},
    }
    first, *_, last = solve_adaptively(Parameters.model_validate(data), MPI.COMM_WORLD)
    assert not first.converged and first.summary["contact_force"] == pytest.approx([0, 0])
    assert last.converged and last.summary["contact_force"][1] < -0.01
    assert len(last.summary["adapt"]["meshes"]) > 3 and last.summary["adapt"]["reached"]
    (fields,) = last.contacts
    assert max(fields.entry.share, fields.entry.missed) < 0.1


def test_a_script_has_the_adapted_meshes_of_the_same_study_file(comm: MPI.Intracomm) -> None:
    smoothing = {"kernel": "convolution", "radius": 0.3}
    limits = {"tolerance": 0.01, "max_meshes": 3}
    study = adaptive(adapt=limits, friction__smoothing=smoothing)
    *_, expected = solve_adaptively(study, comm)
    domain = assemble(study, comm).domain
    parts = {1: "bottom", 2: "left", 3: "top"}
    facets = [domain.facets((name,)) for name in parts.values()]
    marks = np.repeat(list(parts), [len(part) for part in facets]).astype(np.int32)
    order = np.argsort(np.concatenate(facets))
    tags = meshtags(domain.mesh, 1, np.concatenate(facets)[order], marks[order])

    # A third of the cells has the tag 0, a third 5, and the others have none.
    x = compute_midpoints(domain.mesh, 2, np.arange(len(domain.parts), dtype=np.int32))[:, 0]
    tagged = np.flatnonzero((x < 0.33) | (x > 0.67)).astype(np.int32)
    regions = meshtags(domain.mesh, 2, tagged, np.where(x[tagged] < 0.5, 0, 5).astype(np.int32))
    areas = []

    def make(mesh: Any, tags: Any, cells: Any) -> cl.ContactProblem:
        dx = ufl.Measure("dx", mesh, subdomain_data=cells)
        one = fem.Constant(mesh, 1.0)
        areas.append([integral(domain, one * dx(value)) for value in (0, 5)])
        space = fem.functionspace(mesh, ("Lagrange", 1, (2,)))
        clamp = fem.dirichletbc(
            np.zeros(2), fem.locate_dofs_topological(space, 1, tags.find(2)), space
        )
        ds = ufl.Measure("ds", mesh, subdomain_data=tags)(3)
        pull = ufl.inner(ufl.as_vector((0.03, -0.05)), ufl.TestFunction(space)) * ds
        sole = cl.Contact((tags, 1), friction=cl.Coulomb(0.3, cl.Convolution(0.3)))
        elasticity = cl.Elasticity(young=1.0, poisson=0.3)
        return cl.ContactProblem(elasticity, pull, [clamp], [cl.StrainBall(0.02)], [sole])

    *_, last = cl.adapt(make, 0.01, domain.mesh, tags, regions, max_meshes=3)
    assert areas == [pytest.approx(areas[0], rel=1e-12)] * 3 and min(areas[0]) > 0.2
    assert [m["dofs"] for m in meshes(last)] == [m["dofs"] for m in meshes(expected)]
    assert last.summary["contact_force"] == pytest.approx(expected.summary["contact_force"], 1e-8)


@pytest.mark.serial
def test_an_error_that_does_not_fall_ends_the_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(adaptive_meshes, "_LEAST_FALL", 0.0)  # no fall is enough
    solution = solve(adaptive(h=0.5, adapt={"tolerance": 0.001}))
    assert len(meshes(solution)) == 4 and not solution.summary["adapt"]["reached"]


@pytest.mark.serial
@pytest.mark.usefixtures("unrendered")
def test_the_report_of_an_adaptive_run_has_its_meshes(tmp_path: Path) -> None:
    output = {"fields": False, "picture": False}
    solution = solve(adaptive(h=0.5, adapt={"max_meshes": 2}, output=output))
    write(solution, tmp_path)
    page = report.write(tmp_path)[-1].read_text(encoding="utf-8")
    assert all(f">{found['dofs']}<" in page for found in meshes(solution))
