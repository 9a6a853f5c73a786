"""Reports: what they say of a run and of a study, and what they refuse."""

from __future__ import annotations

import copy
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from report_folder import REASON, rows, run_folder, study_folder

from contact_locking import __version__, report
from contact_locking.command import cli
from contact_locking.errors import InputError
from contact_locking.report import charts
from contact_locking.report.shown import shown
from contact_locking.report.templates import environment
from contact_locking.report.trends import Differences
from contact_locking.results import names as result_files

pytestmark = pytest.mark.serial


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run in two dimensions, from which each test has a copy."""
    return run_folder(tmp_path_factory.mktemp("run"))


@pytest.fixture
def own_run(run: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(run, tmp_path / "run"))


@pytest.fixture
def unrendered(monkeypatch: pytest.MonkeyPatch) -> None:
    """Charts are composed and not rendered, which takes most of the time of a report."""
    monkeypatch.setattr(charts, "_rendered", lambda drawing: ("<svg></svg>", b""))


LOADS = """\
mesh: {builder: block, h: 0.5}
contact: {on: bottom}
study: {vary: {loads.tractions: [[], [{on: top, value: [0, 1]}]], penalty.n: [1.0e2, 1.0e3, .inf]}}
"""

quick = pytest.mark.usefixtures("unrendered")


def page(folder: Path) -> str:
    return report.write(folder).read_text(encoding="utf-8")


def change(file: Path, **entries: Any) -> None:
    file.write_text(json.dumps(json.loads(file.read_text()) | entries))


def test_every_text_is_escaped_by_the_templates_and_their_filters() -> None:
    def rendered(source: str, text: str) -> str:
        return environment().from_string(source).render(text=text)

    assert rendered('<p class="{{ text }}">{{ text }}</p>', '"<') == (
        '<p class="&#34;&lt;">&#34;&lt;</p>'
    )
    assert rendered("{{ text | formula }}", "<Γ_C>") == "&lt;Γ<sub>C</sub>&gt;"
    assert rendered("{{ text | key }}", "a.<b>") == "<code>a.<wbr>&lt;b&gt;</code>"
    assert rendered("{{ text | shown }}", "<i>") == "&lt;i&gt;"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1e-5, "10⁻⁵"),
        (1.23456e-12, "1.235×10⁻¹²"),
        (-0.25, "−0.25"),
        (float("inf"), "∞"),
        ("inf", "∞"),
        (True, "yes"),
        (None, "–"),
        (12345, "12\u2009345"),
        (-2, "−2"),
        (10**400, "∞"),
        ([3.0, 1e-20], "(3, 0)"),
        ({"a": [1, None]}, "a: (1, –)"),
    ],
)
def test_values_are_shown_as_one_reads_them(value: Any, text: str) -> None:
    assert shown(value) == text


def test_a_report_of_a_run_says_what_came_out(own_run: Path) -> None:
    text = page(own_run)
    verdict = text.index("<strong>Converged</strong>")
    assert verdict < text.index("<h2>Picture</h2>") < text.index("<h2>Key numbers</h2>")
    for word in (
        '<span title="contact_force">contact force</span>',
        "1\u2009234",
        "(0, 0.125)",
        "✓ holds",
    ):
        assert word in text, word
    # The bound was infinite, which JSON cannot hold, and so was n.
    assert text.count("∞") >= 2
    assert "R hardly &lt;i&gt;smooths" in text
    assert "builder: block" in text
    assert {path.name for path in (own_run / "report").iterdir()} == {
        *("tractions.svg", "tractions.png", "slip.svg", "slip.png")
    }
    for path in (own_run / "report").glob("*.svg"):
        assert ElementTree.parse(path).getroot().tag.endswith("svg")


def test_a_report_of_a_body_in_three_dimensions_has_maps(tmp_path: Path) -> None:
    text = page(run_folder(tmp_path, dim=3))
    names = {path.stem for path in (tmp_path / "report").iterdir()}
    assert names == {"pressure", "friction", "states"}
    assert "from the foundation" in text


@quick
def test_the_names_of_numbers_are_words_and_no_keys(own_run: Path) -> None:
    heads = re.findall(r'<th scope="row">\s*<span[^>]*>(.*?)</span>', page(own_run))
    assert len(heads) >= 5
    assert [head for head in heads if re.search(r"[a-z]{2}_|_[a-z]{2}|\w\.\w", head)] == []


@quick
def test_a_body_without_contact_has_a_report_too(tmp_path: Path) -> None:
    assert "no contact boundary" in page(run_folder(tmp_path, kind="without contact"))


@pytest.mark.parametrize("dim", [2, 3])
def test_each_of_two_contacts_has_a_heading_charts_and_numbers(dim: int, tmp_path: Path) -> None:
    text = page(run_folder(tmp_path, dim, "with two contacts"))
    first, second = text.index("<h3>bottom</h3>"), text.index("<h3>left, a $part$</h3>")
    each = {2: ("tractions", "slip"), 3: ("pressure", "friction", "states")}[dim]
    assert {path.stem for path in (tmp_path / "report").iterdir()} == {
        f"{name}-{number}" for name in each for number in (1, 2)
    }
    assert first < second and text[first:second].count("<svg") == len(each)
    assert text[second:].count("<svg") == len(each)
    for number in ("0.375", "0.0625"):
        assert text[:first].count(f'<span class="number">{number}</span>') == 2
    assert text.count('<th scope="col">left, a $part$</th>') == 1


@quick
def test_contacts_that_the_summary_does_not_name_have_numbers(tmp_path: Path) -> None:
    folder = run_folder(tmp_path, kind="with two contacts")
    change(folder / "summary.json", contacts=[{"on": 3}, None])
    text = page(folder)
    assert "<h3>contact 1</h3>" in text and "<h3>contact 2</h3>" in text


@quick
def test_a_run_that_did_not_converge_says_why_first(own_run: Path) -> None:
    reason, way_out = "infeasible: no field < M near (1, 2)", "Lower them."
    summary = own_run / "summary.json"
    change(summary, converged=False, reason=reason, suggestion=way_out)
    text = page(own_run)
    verdict = r'<div class="verdict bad">\s*<strong>Infeasible on this mesh</strong>'
    assert re.search(rf"<h1>.*</h1>\s*{verdict}", text)
    assert "no field &lt; M near (1, 2)" in text and way_out in text
    change(summary, reason="too many steps")
    assert "<strong>Not converged</strong>" in page(own_run)


@quick
def test_a_restarted_run_says_what_the_saved_state_was_good_for(own_run: Path) -> None:
    assert "Restart" not in page(own_run)
    change(own_run / "summary.json", restart="from the state in <i>a</i>")
    assert "<p>Restart: from the state in &lt;i&gt;a&lt;/i&gt;.</p>" in page(own_run)


@quick
def test_every_part_of_a_certificate_is_shown_whatever_it_is_called(own_run: Path) -> None:
    certificate = {
        "criteria": {"balance": {"value": 2e-3, "limit": 1e-8, "holds": False}},
        "bounds": {
            "displacement_norm": {"value": 1.0, "bound": 2.0, "holds": True},
            "other": {"value": 1.0, "bound": None, "holds": None, "reason": "a gap < 0"},
        },
        "constants": {"alpha": 0.5, "uniqueness": {"verdict": "not known"}},
        "resultants": {"loads": [1.0, 2.0]},
    }
    change(own_run / "summary.json", certificate=certificate)
    text = page(own_run)
    for word in ("Criteria", "✗ fails", "0.002", "10⁻⁸", "not applicable", "a gap &lt; 0"):
        assert word in text
    assert "uniqueness, verdict</span>" in text and "(1, 2)" in text and "Resultants" in text


@quick
def test_the_report_of_an_earlier_run_goes_with_its_results(tmp_path: Path) -> None:
    run_folder(tmp_path)
    report.write(tmp_path)
    run_folder(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        *(result_files.SUMMARY, result_files.PARAMETERS, result_files.CONTACT, result_files.FACETS)
    }


def test_a_folder_of_the_same_name_that_is_no_report_is_left_alone(tmp_path: Path) -> None:
    run_folder(tmp_path)
    own = tmp_path / "report" / "thesis.tex"
    own.parent.mkdir()
    own.touch()
    with pytest.raises(InputError, match="more than charts"):
        report.write(tmp_path)
    (tmp_path / "report.html").write_text("<title>mine</title>")
    run_folder(tmp_path)
    assert own.exists() and (tmp_path / "report.html").exists()


@quick
def test_a_report_replaces_the_one_before_and_leaves_nothing_else(own_run: Path) -> None:
    before = set(os.listdir(own_run))
    report.write(own_run)
    (own_run / "report" / "old.svg").touch()
    report.write(own_run)
    assert set(os.listdir(own_run)) == before | {report.PAGE, report.CHARTS}
    assert not (own_run / "report" / "old.svg").exists()


@quick
def test_a_report_of_a_study_has_every_case_and_the_reasons(tmp_path: Path) -> None:
    text = page(study_folder(tmp_path))
    assert "7 of 8 cases converged" in text and "1 failed" in text
    assert text.count('<tr id="case-') == 8
    # A line separator inside a reason must not cut its row in two.
    assert "was &lt;img src=x onerror=alert(1)&gt; killed by SIGKILL\u2028perhaps" in text
    assert REASON not in text
    assert 'data-value="Infinity"' in text


def test_cases_whose_loads_are_lists_are_told_apart_in_every_part_of_a_page(tmp_path: Path) -> None:
    push, loads = {"on": "right", "value": [0, 1]}, "loads.tractions"
    values = [[{"on": "top", "value": [0, -load]}, push] for load in (1, 2, 3)]
    table = [row | {loads: value} for value in values for row in rows()[:4]]
    for number, row in enumerate(table):
        row["case"] = f"{number:016x}"
    text = page(study_folder(tmp_path, table, LOADS))
    for load in (1, 2, 3):
        told = f"[{{on: top, value: [0, −{load}]}}, …]"
        assert text.count(f'<span class="parts">{told}</span>') == 4
        assert f"tractions = {told}" in "".join(
            chart.read_text() for chart in (tmp_path / "report").glob("*over-penalty.n.svg")
        )
    assert "&#34;on&#34;" not in text and "on: right" not in text.partition("<h2>Parameters")[0]


def test_a_short_geometric_range_has_its_own_values_as_marks(tmp_path: Path) -> None:
    table = rows()[:3]
    for row, n in zip(table, (1.0, 2.0, 4.0), strict=True):
        row["penalty.n"] = n
        row["contact_force.0"] = 3.0 + 1.0 / n
    page(study_folder(tmp_path, table))
    drawing = (tmp_path / "report" / "contact_force-over-penalty.n.svg").read_text()
    # Matplotlib writes texts as paths, with each text as a comment.
    texts = re.findall("<!-- (.*) -->", drawing)
    assert {"1", "2", "4"} <= set(texts) and not any("times" in text for text in texts)


def test_rates_are_those_of_the_numbers(tmp_path: Path) -> None:
    folder = study_folder(tmp_path)
    report.write(folder)
    names = {path.stem for path in (folder / "report").iterdir()}
    force, error = "contact_force-over-penalty.n", "penetration_max-over-penalty.n"
    assert {force, f"{force}-rate", f"{error}-rate"} <= names
    # A quantity with the limit 0 needs no second chart of its distance from the limit.
    assert error not in names
    n = np.array([1e2, 1e3, 1e4, 1e5])
    law: Any = 3.0 / n**1.5
    exact = Differences("", n, law, floor=0.0)
    assert exact.power_law() == pytest.approx((-1.5, 3.0))
    # Below the tolerance there is no rate to see, and none in what jumps.
    floored = Differences("", n, law, floor=1e-4)
    assert floored.power_law() is None
    assert Differences("", n, np.array([1.0, 0.1, 1.0, 0.1]), floor=0.0).power_law() is None


@quick
def test_a_study_without_numbers_to_plot_still_has_its_table(tmp_path: Path) -> None:
    table = rows()[:2]
    for row, state in zip(table, ("failed", "not run"), strict=True):
        row |= {"state": state, "converged": False}
    text = page(study_folder(tmp_path, table))
    assert "0 of 2 cases converged, unfinished" in text
    assert "too few cases have converged" in text


@quick
def test_pictures_of_the_cases_are_inside_the_page(tmp_path: Path, own_run: Path) -> None:
    case = study_folder(tmp_path / "study") / "cases" / rows()[0]["case"]
    run_folder(case, picture=True)
    text = page(tmp_path / "study")
    assert f'href="#picture-{case.name}"' in text and f'id="picture-{case.name}"' in text
    assert text.count("data:image/png") == 1
    (case / "picture.png").write_bytes(b"\x89PNG no more")
    assert "data:image/png" not in page(tmp_path / "study")


CONTACT_ROW = "1,2,0,0,0,0,0,0,0,0,open,0,-1,0\n"
CONTACT = (
    "x,y,u_normal,u_tangent_x,u_tangent_y,gap,pressure,traction_tangent_x,traction_tangent_y,"
    f"bound,state,normal_x,normal_y,contact\n{CONTACT_ROW}"
)
DAMAGE = {
    "no summary": ("summary.json", None, "is not finished"),
    "half a summary": ("summary.json", '{"converged": tr', "not JSON"),
    "deep summary": ("summary.json", "[" * 100_000, "not JSON"),
    "list": ("summary.json", "[1]", "not a mapping"),
    "no verdict": ("summary.json", json.dumps({"version": __version__}), "does not say whether"),
    "other version": ("summary.json", '{"version": "0.0.1", "converged": true}', "version 0.0.1"),
    "no UTF-8": ("summary.json", b"\xff\xfe", "not text in UTF-8"),
    "no contact": ("contact.csv", None, "cannot be read"),
    "empty contact": ("contact.csv", "", "is empty"),
    "strange contact": ("contact.csv", "a,b\n1,2\n", "no column"),
    "half a contact": ("contact.csv", CONTACT.replace(",0\n", ",1.5\n"), "no row of"),
    "unsorted contacts": ("contact.csv", CONTACT + CONTACT_ROW.replace(",0\n", ",-1\n"), "sorted"),
    "far contact": ("contact.csv", CONTACT.replace(",0\n", f",{10**30}\n"), "sorted"),
    "no facets": ("contact_facets.csv", None, "cannot be read"),
    "half a facet": ("contact_facets.csv", "point_0,point_1\n0,\n", "no 2 numbers"),
    "huge facet": ("contact_facets.csv", f"point_0,point_1\n0,{10**30}\n", "no 2 numbers"),
    "strange facet": ("contact_facets.csv", "point_0,point_1\n0,99\n", "not in contact.csv"),
    "no parameters": ("parameters.yaml", None, "cannot be read"),
}


@pytest.mark.parametrize("what", DAMAGE)
def test_a_damaged_run_is_refused_in_words(
    what: str, own_run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content, message = DAMAGE[what]
    file = own_run / name
    file.unlink()
    if content is not None:
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert cli.main(["report", str(own_run)]) == 2
    said = capsys.readouterr().err
    assert message in said and "Traceback" not in said
    assert not (own_run / report.PAGE).exists()


@pytest.mark.parametrize("cell", ["nan", "inf", "", "x", "1e999"])
def test_a_row_of_the_contact_table_that_is_no_row_is_named(cell: str, own_run: Path) -> None:
    file = own_run / "contact.csv"
    lines = file.read_text().splitlines()
    lines[3] = re.sub(r"^[^,]*", cell, lines[3])
    file.write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"contact\.csv:4"):
        report.write(own_run)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("", "is empty"),
        ('{"state": 1}\n', "does not say the state"),
        ("[]\n", "not a mapping"),
        ('{"state": "not run"}\n', "no case of the study is finished"),
        ('{"state": "converged", "version": "9"}\n', "version 9"),
    ],
)
def test_a_damaged_study_is_refused_in_words(table: str, message: str, tmp_path: Path) -> None:
    study_folder(tmp_path)
    (tmp_path / "table.jsonl").write_text(table)
    with pytest.raises(InputError, match=message):
        report.write(tmp_path)


def test_a_study_with_parameters_of_a_run_is_refused(tmp_path: Path) -> None:
    study_folder(tmp_path)
    (tmp_path / "parameters.yaml").write_text("title: no study\n")
    with pytest.raises(InputError, match=r"parameters\.yaml: is damaged: study"):
        report.write(tmp_path)


def test_a_folder_without_results_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    for name, message in (("", "holds no results"), ("file", "no folder"), ("no", "no such")):
        assert cli.main(["report", str(tmp_path / name)]) == 2
        assert message in capsys.readouterr().err


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
        for value in STRANGE[len(key) % 4 :: 4]:
            (own_run / "summary.json").write_text(json.dumps(whole | {key: value}))
            _write_or_refuse(own_run)
    table = rows()
    for number, key in enumerate(table[0]):
        for value in STRANGE[number % 6 :: 6]:
            changed = copy.deepcopy(table)
            changed[0][key] = value
            _write_or_refuse(study_folder(tmp_path / "study", changed))


@pytest.mark.filterwarnings("ignore:overflow")
@pytest.mark.parametrize("key", ["penalty.n", "penetration_max"])
def test_charts_of_extreme_numbers_are_drawn(key: str, tmp_path: Path) -> None:
    table = rows()
    for row, value in zip(table, (1e-300, 1e300, 0.0, -1e300, 1e-320), strict=False):
        row[key] = value
    assert "<svg" in page(study_folder(tmp_path, table))


def _write_or_refuse(folder: Path) -> None:
    try:
        report.write(folder)
    except InputError:
        return


def test_reports_need_no_dolfinx(own_run: Path) -> None:
    script = f"""
import sys
from contact_locking.command import cli
code = cli.main(["report", {str(own_run)!r}])
sys.exit(code or any(name.split(".")[0] in ("dolfinx", "mpi4py") for name in sys.modules))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, ""), done
    assert done.stdout == f"{own_run / 'report.html'}: written\n"
