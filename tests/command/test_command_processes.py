"""The command line as a process: what it imports, readers that leave, and ranks that fail."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import pytest
from problems import UNDRAWN_BLOCK
from slow import slow

from contact_locking import __version__


def separate_process(*words: str, python: str = "-m contact_locking") -> Any:
    return subprocess.run(
        [sys.executable, *python.split(), *words], capture_output=True, text=True, timeout=120
    )


@pytest.mark.serial
def test_the_module_runs_as_a_program() -> None:
    result = separate_process("--version")
    assert (result.returncode, result.stdout) == (0, f"contact-locking {__version__}\n")


@pytest.mark.serial
@pytest.mark.parametrize(("words", "code"), [(["schema"], 0), (["check", "FILE"], 2)])
def test_schema_and_the_check_of_a_wrong_file_need_no_dolfinx_and_no_mpi(
    words: list[str], code: int, tmp_path: Path
) -> None:
    (tmp_path / "wrong.yml").write_text("mesh: {bilder: block}\n")
    words = [str(tmp_path / "wrong.yml") if word == "FILE" else word for word in words]
    script = textwrap.dedent(
        """
        import sys
        from contact_locking.command import cli
        code = cli.main(sys.argv[1:])
        assert not {"dolfinx", "mpi4py", "petsc4py", "gmsh", "ufl"} & set(sys.modules)
        sys.exit(code)
        """
    )
    (tmp_path / "script.py").write_text(script)
    result = separate_process(*words, python=str(tmp_path / "script.py"))
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.serial
@pytest.mark.parametrize("words", [["--help"], ["run", "--help"], ["--version"]], ids=" ".join)
def test_help_imports_nothing_that_takes_time(words: list[str], tmp_path: Path) -> None:
    script = """
import sys
from contact_locking.command import cli
code = cli.main(sys.argv[1:])
slow = {"numpy", "scipy", "pydantic", "ruamel", "rich", "matplotlib", "dolfinx", "mpi4py", "gmsh"}
assert not slow & {name.partition(".")[0] for name in sys.modules}
sys.exit(code)
"""
    (tmp_path / "script.py").write_text(script)
    result = separate_process(*words, python=str(tmp_path / "script.py"))
    assert result.returncode == 0, result.stderr


def without_a_reader(tmp_path: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A command whose output goes to a reader that has left, as head does after its lines."""
    (tmp_path / "study.yml").write_text(UNDRAWN_BLOCK)
    reader, writer = os.pipe()
    # A reader that leaves after a line would race with a short command, which may end first.
    os.close(reader)
    try:
        return subprocess.run(
            [sys.executable, "-m", "contact_locking", *words],
            cwd=tmp_path,
            stdout=writer,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
        )
    finally:
        os.close(writer)


@pytest.mark.serial
@pytest.mark.parametrize(
    "words", ["", slow("--quiet -- -snes_monitor"), slow("-- -ksp_view -snes_monitor")]
)
def test_a_reader_that_leaves_a_run_early_is_no_crash(words: str, tmp_path: Path) -> None:
    newton = ("--set", "solver.method=penalty", *words.split())
    result = without_a_reader(tmp_path, "run", "study.yml", *newton)
    assert (result.returncode, result.stderr) == (-signal.SIGPIPE, "")


LAUNCHER = shutil.which("mpirun")


def launched(tmp_path: Path, body: str) -> subprocess.CompletedProcess[str]:
    """Two ranks that run ``body`` in place of the solve."""
    (tmp_path / "study.yml").write_text(UNDRAWN_BLOCK)
    script = textwrap.dedent(
        f"""
        import sys
        from contact_locking.running import solving
        from contact_locking.command import cli
        from contact_locking.errors import InputError

        def solve(parameters, comm, *_):
            {body}

        solving.solve = solve
        sys.exit(cli.main(["run", "study.yml", "--output", "out", "--quiet"]))
        """
    )
    (tmp_path / "script.py").write_text(script)
    # The environment variables of this process's MPI must not reach the ranks.
    ours = ("OMPI_COMM", "OMPI_FIRST", "PMIX_", "PMI_", "PRTE_LAUNCHED")
    environment = {k: v for k, v in os.environ.items() if not k.startswith(ours)}
    assert LAUNCHER is not None
    return subprocess.run(
        [LAUNCHER, "-n", "2", sys.executable, "script.py"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.mark.serial
@pytest.mark.skipif(LAUNCHER is None, reason="there is no mpirun")
def test_a_defect_on_one_rank_ends_all(tmp_path: Path) -> None:
    body = "assert comm.rank == 0, 'only here'\n            comm.Barrier()"
    result = launched(tmp_path, body)
    assert result.returncode == 1
    assert "unexpected AssertionError: only here" in result.stderr
    assert "(on rank 1)" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.serial
@pytest.mark.skipif(LAUNCHER is None, reason="there is no mpirun")
def test_bad_input_under_mpirun_is_told_once(tmp_path: Path) -> None:
    result = launched(tmp_path, "raise InputError('too steep', 'penalty.n')")
    assert result.returncode == 2
    assert result.stderr.count("error: study.yml:10: penalty.n: too steep") == 1


@pytest.mark.serial
def test_a_run_goes_on_where_its_output_is_closed_or_full(tmp_path: Path) -> None:
    """A descriptor that stayed closed would be that of the next file, such as one of results."""
    study, out = tmp_path / "study.yml", tmp_path / "out"
    study.write_text(UNDRAWN_BLOCK)
    command = [sys.executable, "-m", "contact_locking"]
    with Path("/dev/full").open("w") as full:
        run = subprocess.run(
            [*command, "run", str(study), "--output", str(out)],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=120,
        )
    assert run.returncode == 1 and (out / "summary.json").exists()
    assert run.stderr.count("\n") == 1 and "standard output" in run.stderr
    closed = subprocess.run(
        [*command, "check", str(study)],
        stderr=subprocess.PIPE,
        text=True,
        timeout=120,
        preexec_fn=lambda: os.close(1),
    )
    assert (closed.returncode, closed.stderr) == (0, "")
