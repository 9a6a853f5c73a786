"""Ctrl-C and signals end a solve wherever they arrive, and nothing wrong is told or written."""

from __future__ import annotations

import errno
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest
from problems import SMALL_BLOCK
from slow import slow

from contact_locking import from_mapping, solve
from contact_locking.command import cli, commands
from contact_locking.solver.monitor import Monitor

pytestmark = pytest.mark.serial

LAUNCHER = shutil.which("mpirun")
SPRING = {
    "mesh": {"builder": "block", "h": 0.25},
    "loads": {
        "displacements": [{"on": "left", "value": [0, 0]}],
        "tractions": [{"on": "top", "value": [0, -0.01]}],
    },
    "contact": {"on": "bottom"},
    "penalty": {"n": 100.0},
}


class Impatient(Monitor):
    """Ctrl-C, or an error, while PETSc solves a linear system."""

    def __init__(self, error: BaseException | type[BaseException]) -> None:
        self.error, self.calls = error, 0

    def linear(self, k: int) -> None:
        self.calls += 1
        raise self.error


def test_ctrl_c_inside_a_linear_solve_is_no_failure_of_the_solver() -> None:
    data = SPRING | {"solver": {"linear": "iterative"}}
    monitor = Impatient(KeyboardInterrupt)
    with pytest.raises(KeyboardInterrupt):
        solve(from_mapping(data), monitor=monitor)
    assert monitor.calls == 1


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), BrokenPipeError(), TypeError("k")]
)
def test_what_a_callback_raises_inside_a_linear_solve_is_no_failure_of_the_solver(
    error: Exception,
) -> None:
    data = SPRING | {"solver": {"linear": "iterative"}}
    with pytest.raises(type(error)) as caught:
        solve(from_mapping(data), monitor=Impatient(error))
    assert caught.value is error


def test_an_interrupt_behind_an_error_that_nobody_expects_is_told_as_such(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any) -> int:
        raise RuntimeError("a callback failed") from KeyboardInterrupt()

    monkeypatch.setitem(commands.COMMANDS, "schema", fail)
    assert cli.main(["schema"]) == 130
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.skipif(LAUNCHER is None, reason="there is no mpirun")
@pytest.mark.parametrize("end", [signal.SIGTERM, slow(signal.SIGINT)])
@pytest.mark.parametrize("rank", [slow(0), 1])
def test_a_signal_to_one_rank_inside_its_linear_solver_ends_all_and_leaves_no_results(
    rank: int, end: signal.Signals, tmp_path: Path
) -> None:
    (tmp_path / "study.yml").write_text(SMALL_BLOCK)
    script = f"""
        import os, signal, sys
        from mpi4py import MPI
        from contact_locking.command import cli
        from contact_locking.solver.multigrid import FilteredMultigrid

        signal.signal(signal.SIGINT, signal.default_int_handler)
        apply, calls = FilteredMultigrid.apply, []

        def interrupted(self, r, z, vanishes):
            calls.append(1)
            if len(calls) == 5 and MPI.COMM_WORLD.rank == {rank}:
                os.kill(os.getpid(), {int(end)})
            apply(self, r, z, vanishes)

        FilteredMultigrid.apply = interrupted
        sys.exit(cli.main())
        """
    (tmp_path / "script.py").write_text(textwrap.dedent(script))
    # The environment variables of this process's MPI must not reach the ranks.
    ours = ("OMPI_COMM", "OMPI_FIRST", "PMIX_", "PMI_", "PRTE_LAUNCHED")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    assert LAUNCHER is not None
    words = ["script.py", "run", "study.yml", "--output", "out", "--set", "solver.linear=iterative"]
    done = subprocess.run(
        [LAUNCHER, "-n", "2", sys.executable, *words],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 128 + end
    assert "converged" not in done.stdout
    assert [path.name for path in (tmp_path / "out").iterdir() if path.suffix] == []


_SLIDING = f"""
{SMALL_BLOCK}
steps: {{to: 1, count: 400}}
output: {{picture: false, fields: false}}
"""


def _interrupted_run(
    folder: Path, study: str, *words: str, until: str
) -> tuple[subprocess.Popen[str], str]:
    """A run in its folder ``out`` that Ctrl-C stops at a line of its output, and the line."""
    (folder / "study.yml").write_text(study)
    command = ["run", str(folder / "study.yml"), "--output", str(folder / "out"), *words]
    process = subprocess.Popen(
        [sys.executable, "-m", "contact_locking", *command],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stdout is not None
    line = next(line for line in process.stdout if line.startswith(until))
    process.send_signal(signal.SIGINT)
    return process, line


@pytest.mark.parametrize("words", [slow(()), ("--checkpoint",)])
def test_ctrl_c_keeps_the_steps_and_says_how_to_go_on(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    process, _ = _interrupted_run(tmp_path, _SLIDING, *words, until="step 3")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    first, second = errors.splitlines()
    assert first == "interrupted"
    saved = int(second.split()[0])
    told = f"{saved} steps are saved in {tmp_path / 'out'}; the same command goes on from there"
    assert saved >= 2 and second == told
    again, line = _interrupted_run(tmp_path, _SLIDING, *words, until="going on from")
    again.communicate(timeout=60)
    assert line == f"going on from step {saved} of an earlier run\n"


def test_ctrl_c_before_the_end_of_a_static_solve_says_that_nothing_is_saved(tmp_path: Path) -> None:
    study = SMALL_BLOCK.replace("h: 0.25", "h: 0.006") + "solver: {linear: iterative}\n"
    process, _ = _interrupted_run(tmp_path, study, "--checkpoint", until="  stage")
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130 and "interrupted" in errors
    assert "nothing is saved" in errors
    assert not list((tmp_path / "out").glob("checkpoint*"))
