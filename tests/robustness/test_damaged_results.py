"""Results that are damaged, strange or nowhere are refused by a report in words."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import pytest
from report_folder import quick, rows, study_folder

from contact_locking import __version__
from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.view import report

pytestmark = pytest.mark.serial


CONTACT = (
    "x,y,u_normal,u_tangent_x,u_tangent_y,gap,pressure,traction_tangent_x,traction_tangent_y,"
    "bound,state,normal_x,normal_y,contact\n1,2,0,0,0,0,0,0,0,0,open,0,-1,0\n"
)
DAMAGE = {
    "no summary": ("summary.json", None),
    "half a summary": ("summary.json", '{"converged": tr'),
    "deep summary": ("summary.json", "[" * 100_000),
    "list": ("summary.json", "[1]"),
    "no verdict": ("summary.json", json.dumps({"version": __version__})),
    "other version": ("summary.json", '{"version": "0.0.1", "converged": true}'),
    "no UTF-8": ("summary.json", b"\xff\xfe"),
    "no contact": ("contact.csv", None),
    "empty contact": ("contact.csv", ""),
    "strange contact": ("contact.csv", "a,b\n1,2\n"),
    "half a contact": ("contact.csv", CONTACT.replace(",0\n", ",1.5\n")),
    "far contact": ("contact.csv", CONTACT.replace(",0\n", f",{10**30}\n")),
    "no facets": ("contact_facets.csv", None),
    "half a facet": ("contact_facets.csv", "point_0,point_1\n0,\n"),
    "huge facet": ("contact_facets.csv", f"point_0,point_1\n0,{10**30}\n"),
    "strange facet": ("contact_facets.csv", "point_0,point_1\n0,99\n"),
    "no parameters": ("parameters.yaml", None),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_run_is_refused_in_words(
    what: str, own_run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content = DAMAGE[what]
    file = own_run / name
    file.unlink()
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert cli.main(["report", str(own_run)]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and "Traceback" not in said
    assert not (own_run / report.PAGE).exists()


@pytest.mark.parametrize("cell", ["nan", "", "x"])
def test_a_row_of_the_contact_table_that_is_no_row_is_named(cell: str, own_run: Path) -> None:
    file = own_run / "contact.csv"
    lines = file.read_text().splitlines()
    lines[3] = re.sub(r"^[^,]*", cell, lines[3])
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match="damaged"):
        report.write(own_run)


@pytest.mark.parametrize(
    "table",
    [
        "",
        "[]\n",
        '{"state": "not run"}\n',
        '{"state": "converged", "version": "9"}\n',
    ],
)
def test_a_damaged_study_is_refused_in_words(table: str, tmp_path: Path) -> None:
    study_folder(tmp_path)
    (tmp_path / "table.jsonl").write_text(table)
    with pytest.raises(InputError):
        report.write(tmp_path)


def test_a_folder_without_results_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    for name in ("", "file", "no"):
        assert cli.main(["report", str(tmp_path / name)]) == 2
        assert str(tmp_path / name) in capsys.readouterr().err


@quick
def test_a_folder_that_cannot_be_written_to_is_refused(
    own_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*args: Any, **kwargs: Any) -> str:
        raise PermissionError(13, "Permission denied", str(own_run))

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    with pytest.raises(InputError, match=r"no report can be written in .*Permission denied"):
        report.write(own_run)
    assert not (own_run / report.PAGE).exists()


STRANGE: list[Any] = [None, True, -1, 1e308, 10**400, "text", "</script>", [], [{}], {}, {"a": []}]


@quick
@pytest.mark.filterwarnings("ignore:overflow")
def test_no_value_of_a_summary_or_table_breaks_a_page(own_run: Path, tmp_path: Path) -> None:
    """Each in turn is something else than it should be: a page comes out, or an InputError."""
    whole = json.loads((own_run / "summary.json").read_text())
    for key in [*whole, "certificate", "suggestion", "dolfinx"]:
        for value in STRANGE[len(key) % 11 :: 11]:
            (own_run / "summary.json").write_text(json.dumps(whole | {key: value}))
            _write_or_refuse(own_run)
    table = rows()
    for number, key in enumerate(table[0]):
        for value in STRANGE[number % 11 :: 11]:
            changed = copy.deepcopy(table)
            changed[0][key] = value
            _write_or_refuse(study_folder(tmp_path / "study", changed))


def _write_or_refuse(folder: Path) -> None:
    try:
        report.write(folder)
    except InputError:
        return
