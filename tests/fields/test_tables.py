"""Tables of numbers in CSV files, in the expressions of a study file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI

import contact_locking as cl
from contact_locking import InputError, NotConverged, solve, solve_steps, study_file
from contact_locking.expressions import parse
from contact_locking.running.assembly import assemble
from contact_locking.running.cases import cases_of
from contact_locking.study_file import from_mapping, load

RAMP = "t,force\n0,0\n0.5,-0.05\n1,0\n"
# Spreadsheets begin a file with a byte order mark, and end lines with \r\n.
PROFILE = "\ufeffplace, height ,x\r\n0,0,9\r\n0.5,0.002,9\r\n\r\n1,0.002,9\r\n"
TABLES = {
    "ramp": {"file": "ramp.csv", "over": "t", "column": "force"},
    "profile": {"file": "profile.csv", "over": "place", "column": "height"},
}


@pytest.fixture
def folder(comm: MPI.Intracomm, tmp_path: Path) -> Path:
    """A folder, the same for all ranks, with the files of the tables."""
    place: Path = comm.bcast(tmp_path)
    if comm.rank == 0:
        (place / "ramp.csv").write_text(RAMP)
        (place / "profile.csv").write_text(PROFILE)
    comm.barrier()
    return place


def given(**changes: Any) -> dict[str, Any]:
    """A small block on a foundation, pressed by a load over the time."""
    data: dict[str, Any] = {
        "mesh": {"builder": "block", "h": 0.25, "structured": True},
        "loads": {
            "tractions": [{"on": "top", "value": [0, "ramp(t)"]}],
            "displacements": [{"on": "left", "value": [0, 0]}],
        },
        "contact": {"on": "bottom"},
        "steps": {"times": [0.25, 1]},
        "tables": TABLES,
    }
    return data | changes


def test_a_table_is_linear_between_its_points_and_has_no_value_beyond() -> None:
    table = cl.Tabulated([0, 1, 3], [0, 2, 0], name="f")
    expression = parse("1 + f(x)**2", ("x",), tables={"f": table})
    values = expression.numpy(x=np.array([0.0, 0.5, 1.0, 2.0, 3.0 + 1e-12]))
    assert values == pytest.approx([1.0, 2.0, 5.0, 2.0, 1.0])
    with pytest.raises(InputError, match=r"x = 4.*table 'f' has values from 0 to 3"):
        expression.numpy(x=4.0)
    # The value of a branch that is not taken does not count.
    chosen = parse("f(x) if x < 3 else 7", ("x",), tables={"f": table})
    assert chosen.numpy(x=np.array([1.0, 4.0])) == pytest.approx([2.0, 7.0])
    assert parse("f(1)", (), tables={"f": table}).numpy() == 2.0


def test_a_load_over_the_time_is_the_load_of_each_step(folder: Path) -> None:
    solutions = solve_steps(from_mapping(given(), folder))
    forces = [item.summary["certificate"]["resultants"]["loads"][1] for item in solutions]
    assert forces == pytest.approx([-0.025, 0.0])


@pytest.mark.parametrize("degree", [1, pytest.param(2, marks=pytest.mark.serial)])
def test_a_table_with_points_at_the_nodes_is_the_expression(folder: Path, degree: int) -> None:
    def answer(name: str) -> Any:
        loads = {
            "tractions": [{"on": "top", "value": [0, f"-0.03 - 5*{name}"]}],
            "body_force": [f"2*{name}", 0],
            "displacements": [{"on": "left", "value": [0, f"0.1*{name}"]}],
        }
        data = given(
            loads=loads,
            contact={"on": "bottom", "gap": name},
            friction={"coefficient": f"0.1 + 100*{name}"},
            discretisation={"degree": degree},
        )
        del data["steps"]
        return solve(from_mapping(data, folder))

    found, wanted = answer("profile(x)"), answer("min(0.004*x, 0.002)")
    assert found.converged
    difference = found.displacement.x.array - wanted.displacement.x.array
    largest = np.abs(wanted.displacement.x.array).max(initial=0.0)
    assert np.abs(difference).max(initial=0.0) <= 1e-7 * largest


@pytest.mark.parametrize(
    ("text", "changes", "key", "words"),
    [
        ("t,force\n0,0\n0,1\n", {}, "over", "must ascend, but 0 follows 0"),
        ("t,force\n0,0\n1,nan\n", {}, "file", "row 3, force: 'nan' is no finite number"),
        ("t,force\n0,0\nend,1\n", {}, "file", "row 3, t: 'end' is no finite number"),
        ("t,force\n0,0\n", {}, "over", "at least 2 numbers"),
        ("", {}, "over", "no column 't'"),
        ("t,force\n0,0\n1,1\n", {"column": "forces"}, "column", "did you mean 'force'"),
        ("t;force\n0;0\n1;1\n", {}, "over", "semicolons between its columns"),
        (b"t,force\n0,\xff\n", {}, "file", "no text in UTF-8"),
        ("t,force\n" + "1" * 200_000, {}, "file", "more than 100000 characters"),
    ],
    ids=lambda value: None if isinstance(value, dict) else str(value)[:20],
)
@pytest.mark.serial
def test_a_file_that_is_no_table_is_refused_with_its_key(
    folder: Path, text: str | bytes, changes: dict[str, str], key: str, words: str
) -> None:
    content = text if isinstance(text, bytes) else text.encode()
    (folder / "ramp.csv").write_bytes(content)
    tables = {"ramp": TABLES["ramp"] | changes}
    with pytest.raises(InputError, match=f"tables.ramp.{key}: .*{words}"):
        from_mapping(given(tables=tables), folder)


@pytest.mark.serial
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"tables": {"ramp": {"file": "no.csv", "over": "t", "column": "f"}}}, "no such file"),
        ({"tables": {"sin": TABLES["ramp"]}}, "tables.sin: "),
        ({"tables": None}, r"loads.tractions.0.value.1: .*unknown function 'ramp'"),
        ({"contact": {"on": "bottom", "gap": "ramp(x, 1)"}}, "takes 1 argument, not 2"),
        ({"material": {"locking_limit": "profil(x)"}}, "did you mean 'profile'"),
        ({"steps": None}, "depends on the time t"),
        ({"tables": {**TABLES, "more": {"file": "ramp.csv", "over": "t"}}}, "tables.more.column"),
    ],
)
def test_a_wrong_use_of_a_table_is_refused(
    folder: Path, changes: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        from_mapping(given(**changes), folder)


@pytest.mark.serial
def test_a_time_beyond_the_table_is_refused_with_key_and_range(folder: Path) -> None:
    parameters = from_mapping(given(steps={"times": [0.5, 2]}), folder)
    with pytest.raises(InputError, match="table 'ramp' has values from 0 to 1") as caught:
        assemble(parameters, MPI.COMM_SELF)
    assert caught.value.key == "loads.tractions.0.value.1"


@pytest.mark.serial
def test_a_slip_beyond_the_table_ends_the_solve_that_went_there_and_no_other(folder: Path) -> None:
    """Iterates may slip farther than solutions, so that the file is not at fault."""
    (folder / "wear.csv").write_text("slip,mu\n0,0.3\n1,0.2\n")
    wear = {"wear": {"file": "wear.csv", "over": "slip", "column": "mu"}}
    slips = {"tables": TABLES | wear, "friction": {"coefficient": "wear(s)"}}
    (contact,) = assemble(from_mapping(given(**slips), folder), MPI.COMM_SELF).data.contacts
    count = len(contact.free)
    assert contact.friction.coefficient(np.full(count, 0.5)) == pytest.approx(0.25)
    with pytest.raises(NotConverged, match=r"friction.coefficient: .*values from 0 to 1"):
        contact.friction.coefficient(np.full(count, 2.0))


@pytest.mark.serial
def test_paths_are_relative_to_the_study_file_in_its_cases_too(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir("/")
    (folder / "steep.csv").write_text(RAMP.replace("-0.05", "-0.06"))
    path = folder / "study.yml"
    # The dump has absolute paths.
    text = study_file.dump(from_mapping(given(), folder)).replace(f"{folder}/", "")
    path.write_text(text + "study:\n  vary:\n    tables.ramp.file: [ramp.csv, steep.csv]\n")
    found = cases_of(load(path))
    files = [(case.parameters.tables or {})["ramp"].file for case in found]
    assert files == [str(folder / "ramp.csv"), str(folder / "steep.csv")]
    assert len({case.name for case in found}) == 2


def test_tables_give_the_same_numbers_in_a_script_and_in_a_study_file(folder: Path) -> None:
    data = given(
        contact={"on": "bottom", "gap": "profile(x)"},
        friction={"coefficient": "100*profile(s)", "smoothing": {"kernel": "none"}},
        material={"locking_limit": "wide(x)"},
        tables=TABLES | {"wide": TABLES["profile"] | {"file": "wide.csv"}},
        steps={"times": [0.25, 0.5]},
    )
    if MPI.COMM_WORLD.rank == 0:
        (folder / "wide.csv").write_text("place,height\n0,0.03\n1,0.05\n")
    MPI.COMM_WORLD.barrier()
    parameters = from_mapping(data, folder)
    *_, of_file = solve_steps(parameters)
    profile, mesh = folder / "profile.csv", assemble(parameters, MPI.COMM_WORLD)
    friction = cl.Tabulated([0, 0.5, 1], [0, 0.2, 0.2], "s")
    contact = cl.Contact(
        mesh.domain.facets(["bottom"]),
        gap=cl.Tabulated.read(profile, "place", "height", "x"),
        friction=cl.Coulomb(friction, smoothing=cl.Local()),
    )
    force = cl.Tabulated([0, 0.5, 1], [0, -0.05, 0])
    problem = cl.ContactProblem(
        cl.Elasticity(),
        None,
        [cl.Displacement(mesh.domain.facets(["left"]), [0, 0])],
        [cl.StrainBall(cl.Tabulated([0, 1], [0.03, 0.05], "x"))],
        [contact],
        loads=[cl.Traction(mesh.domain.facets(["top"]), [0, force])],
        space=mesh.u.function_space,
    )
    with pytest.raises(InputError) as caught:
        cl.Process(problem, [0.25, 1.5])
    assert caught.value.key == "loads.tractions.0.value.1"
    *_, of_script = cl.Process(problem, [0.25, 0.5])
    expected = of_file.displacement.x.array
    assert of_file.summary["contact_force"][1] > 0.01
    assert of_script.displacement.x.array == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert of_file.summary["contact_force"] == pytest.approx(of_script.summary["contact_force"])


@pytest.mark.serial
def test_arrays_that_are_no_table_are_refused() -> None:
    lengths, imaginary, equal = ([0, 1], [0, 1, 2]), ([0, 1], [0, 1j]), ([0, 0], [0, 1])
    cases: Any = [(lengths, "values"), (imaginary, "values"), (equal, "points")]
    for (points, values), key in cases:
        with pytest.raises(InputError) as caught:
            cl.Tabulated(points, values)
        assert caught.value.key == f"Tabulated.{key}"
