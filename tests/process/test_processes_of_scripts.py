"""A process, its checkpoints and its files by a script, beside the same process of a study file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import ufl
from dolfinx import fem
from mpi4py import MPI
from problems import all_of, sheared

import contact_locking as cl
from contact_locking.results.table import Table

TIMES = tuple(k / 8 for k in range(1, 9))
# What a process measures of itself, or of rounding.
ITS_OWN = {"seconds", "residual", "nearest_criterion", "energy_defect", "linear", "tangents"}


class Block:
    """The block of `sheared`, with a top that ``put`` moves to its place at a time."""

    def __init__(self, comm: MPI.Intracomm = MPI.COMM_WORLD, mu: float = 0.3) -> None:
        study = cl.assemble(sheared(), comm)
        domain, space = study.domain, study.u.function_space
        self.top, self.now = fem.Constant(domain.mesh, (0.0, 0.0)), 0.0
        self.t = fem.Constant(domain.mesh, 0.0)
        pull = ufl.inner(self.t * ufl.as_vector((0.01, -0.01)), ufl.TestFunction(space))
        dofs = fem.locate_dofs_topological(space, 1, domain.facets(("top",)))
        friction = cl.Coulomb(mu, cl.Convolution(0.25))
        self.problem = cl.ContactProblem(
            cl.Elasticity(young=1.0, poisson=0.3),
            pull * ufl.dx,
            bcs=[fem.dirichletbc(self.top, dofs, space)],
            limits=[cl.StrainBall(0.04)],
            contacts=[cl.Contact(domain.facets(("bottom",)), friction=friction)],
        )

    def put(self, t: float) -> None:
        self.now = t
        self.top.value = (0.02 * math.sin(2.0 * math.pi * t), -0.02 * min(8.0 * t, 1.0))

    def process(self, **more: Any) -> cl.Process[cl.Solution]:
        return cl.Process(self.problem, TIMES, self.put, **more)


def assert_same(found: Table, expected: Table) -> None:
    shared = set(found.columns) & set(expected.columns)
    assert len(shared) > 25 and len(found) == len(expected)
    for name in shared - ITS_OWN:
        size = np.abs(expected.column(name)).max()
        assert found.column(name) == pytest.approx(expected.column(name), abs=1e-8 * size + 1e-12)


def test_a_process_of_a_script_has_the_history_of_the_same_study_file() -> None:
    block, expected = Block(), all_of(sheared())
    process = block.process()
    found = list(process)
    assert [solution.time for solution in found] == list(TIMES)
    assert_same(process.history, expected[-1].history)
    for one, other in zip(found, expected, strict=True):
        assert one.summary["contact_force"] == pytest.approx(other.summary["contact_force"], 1e-8)
    # The problem is solved further, and another process starts at rest.
    block.put(0.125)
    again = block.problem.solve()
    block.put(0.25)
    second = block.problem.solve(after=again)
    assert second.summary["slip_max"] == pytest.approx(found[1].summary["slip_max"], 1e-8)
    assert again.summary["contact_force"] == pytest.approx(found[0].summary["contact_force"], 1e-8)
    assert next(block.process()).displacement.x.array == pytest.approx(again.displacement.x.array)


def test_a_constant_is_the_time_of_a_process() -> None:
    block = Block()
    process = cl.Process(block.problem, cl.Steps(to=1, count=2), block.t)
    forces = [solution.summary["friction_force"][0] for solution in process]
    assert forces[1] == pytest.approx(2.0 * forces[0]) and abs(forces[0]) > 1e-4
    with pytest.raises(cl.InputError) as caught:
        cl.Process(block.problem, [1.0, 0.5], block.t)
    assert caught.value.key == "Steps.times"


@pytest.mark.usefixtures("unrendered")
def test_the_files_of_a_process_of_a_script_are_read_back(tmp_path: Path) -> None:
    folder = Path(MPI.COMM_WORLD.bcast(tmp_path))
    process = Block().process()
    cl.write(next(process), folder)
    solution, _ = cl.write_steps(process, folder)
    MPI.COMM_WORLD.Barrier()
    names = {path.name for path in folder.iterdir()} - {"picture.png"}
    texts = {"summary.json", "contact.csv", "contact_facets.csv", "history.csv"}
    assert names == texts | {"fields.vtkhdf"}
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["contact_force"] == solution.summary["contact_force"]
    assert_same(Table.read((folder / "history.csv").read_text(), "history.csv"), process.history)
    points = Table.read((folder / "contact.csv").read_text(), "contact.csv", ["state"])
    if expected := solution.contact_points:
        assert points.column("pressure") == pytest.approx(expected.pressure)


def test_a_grid_of_cases_has_a_row_and_a_folder_for_each(
    tmp_path: Path, comm: MPI.Intracomm
) -> None:
    def make(mu: float, down: float) -> cl.ContactProblem | cl.Process[cl.Solution]:
        block = Block(mu=mu)
        block.top.value = (0.01, -down)
        return block.problem if down < 0.02 else cl.Process(block.problem, cl.Steps(to=1, count=1))

    folder, grid = comm.bcast(tmp_path), {"mu": [0.1, -1.0], "down": {"linear": [0.01, 0.02, 2]}}
    output = cl.Output(fields=False, picture=False, probes=[cl.Probe([[0.5, 1.0]])])
    rows = cl.solve_cases(make, grid, folder, output)
    assert [(row["mu"], row["down"], row["state"]) for row in rows] == [
        *((0.1, 0.01, "converged"), (0.1, 0.02, "converged")),
        *((-1.0, 0.01, "failed"), (-1.0, 0.02, "failed")),
    ]
    assert "Coulomb.coefficient" in rows[2]["reason"] and rows[1]["steps.solved"] == 1
    lines = (folder / "table.csv").read_text().splitlines()
    assert len(lines) == 5 and lines[0].startswith("mu,down,case,state,converged")
    for number, row in enumerate(rows[:2], start=1):
        case = folder / "cases" / f"{number:04d}"
        summary = json.loads((case / "summary.json").read_text())
        assert summary["contact_force"][1] == row["contact_force.1"]
        head, probe = (line.split(",") for line in (case / "probes.csv").read_text().splitlines())
        assert float(probe[head.index("u_y")]) == pytest.approx(-row["down"])
