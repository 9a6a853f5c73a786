"""The command line: exit codes, one clear message, rank 0 alone speaks."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from mpi4py import MPI
from problems import UNDRAWN_BLOCK

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


def test_mesh_writes_a_file_that_runs(folder: Path, comm: MPI.Intracomm) -> None:
    body = folder / "body.msh"
    assert cli.main(["mesh", str(folder / "study.yml"), "-o", str(body)]) == 0
    comm.Barrier()
    assert run(folder, "--quiet", "--set", f"mesh={{file: {body}}}") == 0


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
def test_schema_is_json_on_demand(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["schema", "--json"]) == 0
    assert "penalty" in json.loads(capsys.readouterr().out)["properties"]


@pytest.mark.serial
@pytest.mark.parametrize("name", ["body.msh", "body.xdmf"])
def test_mesh_replaces_no_file_and_no_link(
    name: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["mesh", str(folder / "study.yml"), "-o", str(folder / name)]
    theirs = (folder / name).with_suffix(".h5" if name.endswith("xdmf") else ".msh")
    theirs.write_text("mine")
    assert cli.main(words) == 2
    assert f"{theirs}: there is a file already" in capsys.readouterr().err
    assert theirs.read_text() == "mine"
    theirs.unlink()
    (folder / name).symlink_to(folder / "nowhere")
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
