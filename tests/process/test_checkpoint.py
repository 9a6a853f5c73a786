"""Checkpoints: read on any number of ranks, and complete or refused."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from mpi4py import MPI
from problems import block

from contact_locking import files, save, study_file
from contact_locking.arrays import FloatArray
from contact_locking.command import cli
from contact_locking.errors import ContactLockingError, InputError
from contact_locking.process.checkpoint import locate
from contact_locking.results.solution import StudySolution
from contact_locking.running import solving
from contact_locking.study_file.parameters import Parameters

COARSE = {2: 0.2, 3: 0.34}
PLAIN = {"fields": False, "picture": False}


def parameters(dim: int = 2, **changes: Any) -> Parameters:
    given = {"friction__smoothing__radius": 0.4, "output": PLAIN, **changes}
    return block(dim, given.pop("h", COARSE[dim]), **given)


def on_rank_0(comm: MPI.Intracomm, work: Callable[[], object]) -> None:
    if comm.rank == 0:
        work()
    comm.Barrier()


class Values(NamedTuple):
    """Values that no distribution changes: numbers, and columns over Gamma_C on rank 0."""

    numbers: list[float]
    columns: FloatArray

    @classmethod
    def of(cls, solution: StudySolution) -> Values:
        summary, points = solution.summary, solution.contact_points
        names = ("compliance", "elastic_energy", "strain_norm_max", "contact_area")
        numbers = [summary[name] for name in names] + summary["friction_force"]
        if points is None:
            return cls(numbers, np.empty(0))
        columns = (points.u_normal, points.u_tangent, points.pressure, points.traction)
        return cls(numbers, np.column_stack([*columns, points.bound, points.state]))

    def agrees(self, other: Values) -> bool:
        """Whether all values agree up to the rounding of sums."""
        np.testing.assert_allclose(self.numbers, other.numbers, rtol=1e-12, atol=1e-15)
        if self.columns.size and other.columns.size:
            np.testing.assert_allclose(self.columns, other.columns, rtol=0.0, atol=1e-14)
        return True


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("n", [1e3, float("inf")])
def test_a_saved_solution_is_read_as_it_was_and_solves_its_problem(
    dim: int, n: float, folder: Path
) -> None:
    given = parameters(dim, penalty__n=n)
    solution = solving.solve(given)
    save(solution, folder)
    again = solving.solve(given, restart=folder)
    assert again.converged
    assert again.summary["iterations"] == {"tangents": 0, "linear": 0, "friction": 0}
    assert again.summary["restart"].endswith("already meets every criterion")
    for name in ("displacement", "locking_stress", "contact_pressure", "tangential_traction"):
        before, after = (getattr(each, name).x.array for each in (solution, again))
        np.testing.assert_allclose(after, before, rtol=0.0, atol=1e-15 * np.abs(before).max())
    assert Values.of(again).agrees(Values.of(solution))


@pytest.mark.parametrize("dim", [2, 3])
def test_one_rank_reads_what_all_have_saved_and_all_what_one_has(dim: int, folder: Path) -> None:
    # Says little on one rank; the other numbers of ranks are below.
    given, alone = parameters(dim), MPI.COMM_SELF
    together = solving.solve(given)
    save(together, folder / "together")
    own = solving.solve(given, alone, restart=folder / "together")
    assert own.summary["iterations"]["tangents"] == 0
    assert Values.of(own).agrees(Values.of(together))
    save(own, folder / f"of rank {MPI.COMM_WORLD.rank}")
    MPI.COMM_WORLD.Barrier()
    back = solving.solve(given, restart=folder / "of rank 0")
    assert back.summary["iterations"]["tangents"] == 0
    assert Values.of(back).agrees(Values.of(together))


@pytest.fixture
def saved(comm: MPI.Intracomm, folder: Path) -> Path:
    """The checkpoint of a made-up solve."""
    save(solving.solve(parameters()), folder / "run")
    comm.Barrier()
    return folder / "run"


def refusal(directory: Path, given: Parameters | None = None) -> str:
    with pytest.raises(InputError) as caught:
        solving.solve(given or parameters(), restart=directory)
    return str(caught.value)


@pytest.mark.serial
@pytest.mark.parametrize(
    "changes",
    [
        {"h": 0.1},
        {"mesh__structured": True},
        {"mesh__size": [1.0, 1.001]},
        {"dim": 3},
        {"discretisation": {"degree": 2}},
    ],
)
def test_a_state_of_another_mesh_or_element_is_refused(
    changes: dict[str, Any], saved: Path
) -> None:
    assert "is of another mesh or element" in refusal(saved, parameters(**changes))


def test_fields_that_are_not_complete_are_refused(saved: Path, comm: MPI.Intracomm) -> None:
    path = locate(saved) / "state.npz"
    content = path.read_bytes()
    comm.Barrier()
    changed = bytes([content[0] ^ 1]) + content[1:]
    for text in (content[:-7], changed):
        on_rank_0(comm, partial(path.write_bytes, text))
        assert "damaged" in refusal(saved)
    on_rank_0(comm, path.unlink)
    assert "is missing" in refusal(saved)
    on_rank_0(comm, partial((path.parent / "record.json").write_text, '{"format": 99}'))
    assert "is damaged" in refusal(saved)
    assert "no checkpoint" in refusal(saved / "nowhere")


def full(folder: Path, _: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(folder))


def test_a_save_that_fails_leaves_the_earlier_one(
    saved: Path, comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    solution = solving.solve(parameters(friction__coefficient=0.1))
    monkeypatch.setattr(files, "require_room", full)
    with pytest.raises(ContactLockingError, match="No space left"):
        save(solution, saved)
    comm.Barrier()
    assert {path.name for path in saved.iterdir()} == {"checkpoint"}
    monkeypatch.undo()
    assert solving.solve(parameters(), restart=saved).summary["iterations"]["tangents"] == 0


def given(method: str, dim: int = 2, load: float = 1.0, **changes: Any) -> Parameters:
    """The model case with its traction times ``load``."""
    pull = [0.03 * load, *[0.0] * (dim - 2), -0.05 * load]
    loads = {
        "tractions": [{"on": "top", "value": pull}],
        "displacements": [{"on": "left", "value": [0.0] * dim}],
    }
    h = 0.1 if dim == 2 else 0.34
    return block(dim, h, **{"solver__method": method, "loads": loads, **changes})


def tangents(solution: StudySolution) -> int:
    return int(solution.summary["iterations"]["tangents"])


def agree(one: StudySolution, other: StudySolution, digits: float = 1e-8) -> bool:
    assert one.converged and other.converged, (one.summary["reason"], other.summary["reason"])
    for key in ("compliance", "elastic_energy", "strain_norm_max"):
        assert one.summary[key] == pytest.approx(other.summary[key], rel=digits), key
    for key in ("contact_force", "friction_force"):
        assert one.summary[key] == pytest.approx(other.summary[key], rel=10 * digits, abs=1e-9), key
    return True


class Run:
    """The command line on one study file in one folder."""

    def __init__(self, folder: Path, comm: MPI.Intracomm) -> None:
        self.folder, self._comm = folder, comm
        text = study_file.dump(parameters())
        on_rank_0(comm, lambda: (folder / "study.yml").write_text(text, encoding="utf-8"))

    def __call__(self, name: str, *words: str) -> int:
        words = (*words, "--output", str(self.folder / name))
        code = cli.main(["run", str(self.folder / "study.yml"), *words])
        self._comm.Barrier()
        return code

    def names(self, name: str) -> set[str]:
        found = {path.name for path in (self.folder / name).iterdir()}
        self._comm.Barrier()
        return found


@pytest.fixture
def run(folder: Path, comm: MPI.Intracomm) -> Run:
    return Run(folder, comm)


RESULTS = {
    "summary.json",
    "parameters.yaml",
    "contact.csv",
    "contact_facets.csv",
}


def test_run_saves_a_checkpoint_if_asked_and_says_what_a_restart_did(
    run: Run, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("a", "--quiet", "--checkpoint") == 0
    assert run.names("a") == RESULTS | {"checkpoint"}
    start = ("--restart", str(run.folder / "a"))
    for changes, told in (
        ((), "already meets every criterion"),
        (("--set", "friction.coefficient=0.31"), f"from the state in {run.folder / 'a'}\n"),
        (("--set", "penalty.n=1e5"), f"from the state in {run.folder / 'a'}\n"),
    ):
        assert run("b", *start, *changes) == 0
        output = capsys.readouterr().out
        assert (told in output) == (comm.rank == 0)
    # No file of an earlier run stays in the folder.
    assert run("a", "--quiet") == 0
    assert run.names("a") == RESULTS


def test_run_keeps_the_checkpoint_that_it_starts_from(
    run: Run, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("a", "--quiet", "--checkpoint") == 0
    start = ("--quiet", "--restart", str(run.folder / "a"))
    assert run("a", *start) == 2
    assert ("add --checkpoint" in capsys.readouterr().err) == (comm.rank == 0)
    assert run("a", *start, "--checkpoint", "--set", "friction.coefficient=0.1") == 0
    assert run.names("a") == RESULTS | {"checkpoint"}
