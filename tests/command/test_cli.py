"""The command line: exit codes, one clear message, rank 0 alone speaks."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from mpi4py import MPI
from problems import UNDRAWN_BLOCK
from slow import slow

from contact_locking import meshes, study_file
from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.running import solving


@pytest.fixture
def folder(comm: MPI.Intracomm, tmp_path: Path) -> Path:
    """One folder for all ranks, with a study file."""
    shared = comm.bcast(tmp_path)
    if comm.rank == 0:
        (shared / "study.yml").write_text(UNDRAWN_BLOCK)
    comm.Barrier()
    return shared


def run(folder: Path, *words: str) -> int:
    return cli.main(["run", str(folder / "study.yml"), "--output", str(folder / "out"), *words])


def test_a_converged_run_returns_0_and_only_rank_0_prints_its_table(
    folder: Path, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder) == 0
    output, errors = capsys.readouterr()
    assert errors == ""
    if comm.rank == 0:
        assert "stage 1" in output and "friction update" in output
        for name in ("converged ", "locked ", "contact force ", "results in "):
            assert f"\n{name}" in output
        assert json.loads((folder / "out" / "summary.json").read_text())["converged"] is True
    else:
        assert output == ""


@pytest.mark.parametrize("words", [["--version"], ["run", "--help"]], ids=" ".join)
def test_only_rank_0_prints_version_and_help(
    words: list[str], comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(words) == 0
    assert bool(capsys.readouterr().out) == (comm.rank == 0)


def test_settings_change_the_file_and_are_saved(folder: Path, comm: MPI.Intracomm) -> None:
    words = ["run", "--quiet", "--set", "penalty.n=50", "friction.coefficient=0.1"]
    assert cli.main([*words, str(folder / "study.yml"), "--output", str(folder / "a b: [c]")]) == 0
    comm.Barrier()
    saved = study_file.load(folder / "a b: [c]" / "parameters.yaml").parameters
    assert saved.penalty.n == 50.0
    assert saved.friction.coefficient == 0.1


def test_a_run_that_does_not_converge_returns_3_and_saves_what_it_reached(
    folder: Path, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "--quiet", "--set", "solver.max_iterations=1") == 3
    errors = capsys.readouterr().err
    assert json.loads((folder / "out" / "summary.json").read_text())["converged"] is False
    if comm.rank == 0:
        assert errors.startswith("error: not converged: ")
        assert (
            "solver.max_iterations" in errors
            and f"The state that it reached is in {folder / 'out'}." in errors
        )
    else:
        assert errors == ""


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("contact.on=bottm", "there are left, right, bottom, top"),
        ("penalty.n=-1", "--set penalty.n: must be > 0, not -1"),
        ("penalty.m=1", "--set penalty.m: unknown key"),
        ("loads.displacements=[]", "loads.displacements"),
        ("contact.on=left", "Gamma_D"),
        ("friction.coefficient=__import__('os')", "friction.coefficient"),
        ("friction.coefficient=0.3 - 0.4*x", "it is -0.1 at x = 1"),
        (
            "loads.tractions=[{on: top, value: [0, sqrt(x - 0.5)]}]",
            "'sqrt(x - 0.5)' is nan at x = ",
        ),
        ("loads.body_force=[0, log(y - 0.5)]", "'log(y - 0.5)' is nan at y = "),
        ("output.directory=/dev/null/results", "/dev/null"),
    ],
)
def test_bad_input_returns_2_with_one_message_and_writes_nothing(
    setting: str,
    message: str,
    folder: Path,
    comm: MPI.Intracomm,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = folder / "out"
    words = [] if setting.startswith("output") else ["--output", str(out)]
    code = cli.main(["run", str(folder / "study.yml"), *words, "--quiet", "--set", setting])
    assert code == 2
    errors = capsys.readouterr().err
    assert not out.exists()
    if comm.rank == 0:
        assert errors.startswith("error: ") and errors.count("error") == 1
        assert message in errors
        assert "Traceback" not in errors
    else:
        assert errors == ""


def test_a_file_with_a_study_runs_its_base_case_and_says_so(
    folder: Path, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    if comm.rank == 0:
        (folder / "study.yml").write_text(
            f"{UNDRAWN_BLOCK}study: {{vary: {{penalty.n: [10, 100]}}}}\n"
        )
    comm.Barrier()
    assert run(folder) == 0
    assert ("base case" in capsys.readouterr().out) == (comm.rank == 0)


def test_check_says_what_would_run_and_leaves_no_trace(
    folder: Path, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    word = f"output.directory={folder / 'out'}"
    assert cli.main(["check", str(folder / "study.yml"), "--set", word]) == 0
    output = capsys.readouterr().out
    assert not (folder / "out").exists()
    if comm.rank == 0:
        assert "can be run" in output and "dofs" in output and "(0, -1)" in output


def test_check_finds_what_only_the_mesh_can_tell(
    folder: Path, comm: MPI.Intracomm, capsys: pytest.CaptureFixture[str]
) -> None:
    body = folder / "body.msh"
    if comm.rank == 0:
        meshes.write(meshes.BUILDERS["block"](h=0.5), body)
    comm.Barrier()
    words = ["--set", f"mesh={{file: {body}}}", "contact.on=under"]
    assert cli.main(["check", str(folder / "study.yml"), *words]) == 2
    if comm.rank == 0:
        errors = capsys.readouterr().err
        assert "'under'" in errors and "bottom, left, right, top" in errors


@pytest.mark.serial
@pytest.mark.parametrize("name", ["body.vtk", "missing/body.msh"])
def test_mesh_refuses_a_file_that_it_cannot_write(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["mesh", str(folder / "study.yml"), "-o", str(folder / name)]) == 2
    assert capsys.readouterr().err.count("error: ") == 1


@pytest.mark.serial
@pytest.mark.parametrize("debug", [False, True])
def test_a_defect_returns_1_with_a_traceback_only_if_asked_for(
    debug: bool,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def solve(*_: object) -> None:
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr(solving, "solve", solve)
    assert run(folder, "--quiet", *["--debug"] * debug) == 1
    errors = capsys.readouterr().err
    assert "error: unexpected ZeroDivisionError: a defect" in errors
    assert ("Traceback" in errors) == debug
    assert ("please report it" in errors) != debug


@pytest.mark.serial
def test_an_interrupt_returns_130_without_a_traceback(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def solve(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(solving, "solve", solve)
    assert run(folder, "--quiet") == 130
    assert capsys.readouterr().err == "interrupted\n"


@pytest.mark.serial
def test_mesh_replaces_no_file_and_no_link(folder: Path) -> None:
    theirs = folder / "body.msh"
    words = ["mesh", str(folder / "study.yml"), "-o", str(theirs)]
    theirs.write_text("mine")
    assert cli.main(words) == 2
    assert theirs.read_text() == "mine"
    theirs.unlink()
    theirs.symlink_to(folder / "nowhere")
    assert cli.main(words) == 2


@pytest.mark.serial
def test_petsc_options_are_pairs_or_flags() -> None:
    words = ["-a", "-1e-3", "-b", "--c", "value"]
    assert cli.petsc_options(words) == {"a": "-1e-3", "b": None, "c": "value"}
    for wrong in (["value"], ["-a", "1", "2"]):
        with pytest.raises(InputError, match="begin with a dash"):
            cli.petsc_options(wrong)


@pytest.mark.serial
@pytest.mark.parametrize(
    "words", [[], ["solve"], ["run"], ["run", "a", "b"], ["schema", "--", "-x"], ["mesh", "a"]]
)
def test_wrong_words_return_2_with_one_message(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(words) == 2
    assert capsys.readouterr().err.startswith("error: ")


HEAVY = "dolfinx mpi4py petsc4py gmsh ufl"
SLOW = f"numpy scipy pydantic ruamel matplotlib {HEAVY}"


@pytest.mark.serial
@pytest.mark.parametrize(
    ("words", "code", "needless"),
    [
        ("--version", 0, SLOW),
        ("run --help", 0, SLOW),
        ("schema", 0, HEAVY),
        ("schema --json", 0, HEAVY),
        ("check wrong.yml", 2, HEAVY),
    ],
)
def test_what_solves_nothing_imports_nothing_that_takes_time(
    words: str, code: int, needless: str, tmp_path: Path
) -> None:
    (tmp_path / "wrong.yml").write_text("mesh: {bilder: block}\n")
    script = f"""
import sys
from contact_locking.command import cli
code = cli.main({words.split()!r})
assert not {set(needless.split())!r} & {{name.partition(".")[0] for name in sys.modules}}
sys.exit(code)
"""
    result = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert result.returncode == code, result.stderr
    assert "Traceback" not in result.stderr


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


def test_mesh_writes_a_file_that_runs(folder: Path, comm: MPI.Intracomm) -> None:
    body = folder / "body.msh"
    assert cli.main(["mesh", str(folder / "study.yml"), "-o", str(body)]) == 0
    comm.Barrier()
    assert run(folder, "--quiet", "--set", f"mesh={{file: {body}}}") == 0
