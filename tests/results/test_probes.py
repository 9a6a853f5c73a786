"""Probes: the values of chosen points, the same on any number of ranks and at every step."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import BOTH_DEGREES, block, square

from contact_locking import InputError, Parameters, solve
from contact_locking.running.assembly import assemble
from contact_locking.running.run import run
from contact_locking.solver.monitor import Monitor

POINTS = [[0.5, 0.5], [0.1, 0.7], [1.0, 1.0], [0.5, 0.0]]
PROBES = [{"points": POINTS}, {"line": {"from": [0, 0.5], "to": [1, 0.5], "count": 5}}]


def table(text: str) -> dict[str, list[float]]:
    """The columns of probes.csv."""
    header, *lines = text.splitlines()
    values = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    return dict(zip(header.split(","), map(list, values.T), strict=True))


def probed(parameters: Parameters, comm: MPI.Intracomm = MPI.COMM_WORLD) -> Any:
    """The table that the run writes, the same on all ranks."""
    solution = solve(parameters, comm)
    assert solution.probes is not None
    return comm.bcast(solution.probes.text() if comm.rank == 0 else None)


@BOTH_DEGREES
@pytest.mark.parametrize("dim", [2, 3])
def test_probes_of_a_homogeneous_state_have_its_values(dim: int, degree: int) -> None:
    # An elastic block between rollers below and on the left, under a pressure from above.
    names = ["left", "bottom"] if dim == 2 else ["left", "front", "bottom"]
    rollers = [
        {"on": name, "value": [0 if axis == other else None for other in range(dim)]}
        for axis, name in enumerate(names)
    ]
    inner = [0.3, 0.6, 0.2][:dim]
    found = table(
        probed(
            block(
                dim,
                0.5,
                loads={
                    "pressures": [{"on": "top", "value": 0.03}],
                    "displacements": rollers,
                },
                contact=[],
                discretisation={"degree": degree},
                material__locking_limit=math.inf,
                output={"probes": [{"points": [inner]}]},
            )
        )
    )
    axes = "xyz"[:dim]
    last = axes[-1]
    for i, first in enumerate(axes):
        for second in axes[i:]:
            wanted = -0.03 if first == second == last else 0.0
            assert found[f"stress_{first}{second}"] == pytest.approx([wanted], abs=1e-9)
            assert found[f"locking_stress_{first}{second}"] == pytest.approx([0.0], abs=1e-9)
    # With E = 1 and nu = 0.3; a body in 2D is in plane strain.
    along, across = (-0.03 * 0.91, 0.03 * 0.39) if dim == 2 else (-0.03, 0.009)
    strains = [across] * (dim - 1) + [along]
    for axis, strain, x in zip(axes, strains, inner, strict=True):
        assert found[f"u_{axis}"] == pytest.approx([strain * x], abs=1e-9)
    assert found["strain_norm"] == pytest.approx([np.linalg.norm(strains)], abs=1e-9)


@BOTH_DEGREES
def test_probes_do_not_depend_on_the_ranks(degree: int) -> None:
    parameters = square(output={"probes": PROBES}, discretisation={"degree": degree})
    together = table(probed(parameters))
    alone = table(probed(parameters, MPI.COMM_SELF))
    assert list(together) == list(alone)
    assert "step" not in together
    assert together["probe"] == [0] * 4 + [1] * 5
    assert together["point"] == [*range(4), *range(5)]
    assert together["x"] == [0.5, 0.1, 1.0, 0.5, 0.0, 0.25, 0.5, 0.75, 1.0]
    for name, values in together.items():
        assert values == pytest.approx(alone[name], abs=1e-7), name
    # The middle of the block is a point of both probes.
    for name in set(together) - {"probe", "point"}:
        assert together[name][0] == together[name][6]


class _Stopping(Monitor):
    """Stops a process before its second step."""

    def step(self, number: int, left: int, time: float) -> None:
        if number == 2:
            raise KeyboardInterrupt


@pytest.mark.parametrize("stopped", [False, True])
def test_a_process_has_a_row_for_each_step_and_point(tmp_path: Path, stopped: bool) -> None:
    folder = MPI.COMM_WORLD.bcast(tmp_path)
    loads = {
        "pressures": [{"on": "top", "value": "0.04*t"}],
        "displacements": [{"on": "right", "value": [0, 0]}],
    }
    output = {"probes": PROBES, "fields": False, "picture": False}
    parameters = square(loads=loads, steps={"times": [0.5, 1.0]}, output=output)
    if stopped:
        with pytest.raises(KeyboardInterrupt):
            run(parameters, folder, monitor=_Stopping())
    solution, _ = run(parameters, folder)
    found = table((folder / "probes.csv").read_text())
    assert found["step"] == [1] * 9 + [2] * 9
    assert found["t"] == [0.5] * 9 + [1.0] * 9
    assert solution.converged


@pytest.mark.serial
@pytest.mark.parametrize(
    ("probe", "key"),
    [
        ({"points": [[0.5, 0.5], [0.5, 1.01]]}, "output.probes.1.points.1"),
        ({"line": {"from": [0.5, 0.5], "to": [1.5, 0.5], "count": 3}}, "output.probes.1.line"),
    ],
)
def test_a_point_outside_of_the_body_is_refused_before_the_solve(probe: Any, key: str) -> None:
    with pytest.raises(InputError, match="outside of the mesh") as caught:
        assemble(square(output={"probes": [{"points": [[0, 0]]}, probe]}), MPI.COMM_WORLD)
    assert caught.value.key == key


def test_tables_tell_their_units_and_are_saved_as_arrays(tmp_path: Path) -> None:
    solution = solve(square(output={"probes": PROBES}))
    if solution.contact_points is None or solution.probes is None:
        return
    units = {"x": "length", "u_y": "length", "strain_norm": "1", "stress_xy": "stress"}
    for sampled in (solution.probes, solution.contact_points.table):
        sampled.save(tmp_path / "table.npz")
        with np.load(tmp_path / "table.npz") as stored:
            assert len(stored["units"]) == len(sampled.columns)
            told = dict(zip(sampled.columns, stored["units"].tolist(), strict=True))
            assert np.array_equal(stored["x"], sampled.columns["x"])
        assert all(told[name] == units[name] for name in units.keys() & told.keys())
    assert told["pressure"] == told["bound"] == "stress" and told["state"] == "1"
