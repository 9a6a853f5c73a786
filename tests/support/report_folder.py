"""Folders of results for the tests of reports, as `run` and `study` leave them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from solutions import of_kind

from contact_locking import __version__, study_file
from contact_locking.running import run as writing
from contact_locking.view import report

TITLE = "<script>document.title = 'run'</script> & \"$x_1\" Käfer"
STUDY = """\
mesh: {builder: block, h: 0.5}
contact: {on: bottom}
friction: {smoothing: {radius: 0.6}}
study: {vary: {friction.coefficient: [0.1, 0.2], penalty.n: [1.0e2, 1.0e3, 1.0e4, .inf]}}
"""
REASON = "was <img src=x onerror=alert(1)> killed by SIGKILL\u2028perhaps"

#: For tests of what a page says, which do without rendered charts.
quick = pytest.mark.usefixtures("unrendered")


def run_folder(
    folder: Path, dim: int = 2, kind: str = "locked", picture: bool = False, **summary: Any
) -> Path:
    """The folder of a run of one of the kinds of solutions, with changes of its summary."""
    wanted = {"fields": False, "picture": picture, "directory": "r"}
    entries = {
        "title": TITLE,
        "version": __version__,
        "iterations": {"tangents": 20, "linear": 69, "friction": 18},
        "stages": [{"n": float("inf"), "epsilon": 0.0, "tangents": 20}],
        "warnings": ["R hardly <i>smooths</i>"],
        **summary,
    }
    solution = of_kind(dim, kind, title=TITLE, output=wanted).with_entries(**entries)
    writing.write(solution, folder)
    return folder


def rows() -> list[dict[str, Any]]:
    """The rows of a study whose penetration is mu/n, and of which one case was killed."""
    cases = [(mu, n) for mu in (0.1, 0.2) for n in (1e2, 1e3, 1e4, float("inf"))]
    table: list[dict[str, Any]] = [
        {
            "friction.coefficient": mu,
            "penalty.n": n if n < float("inf") else "inf",
            "case": f"{index:016x}",
            "state": "converged",
            "converged": True,
            "reason": "every criterion held",
            "penetration_max": mu / n,
            "contact_force.0": 3.0 * (1 + 1 / n),
            "contact_force.1": 4.0 * (1 + 1 / n),
            "dofs": 290,
            "version": __version__,
        }
        for index, (mu, n) in enumerate(cases)
    ]
    table[5] = dict.fromkeys(table[5]) | {
        **{key: table[5][key] for key in ("friction.coefficient", "penalty.n", "case")},
        **{"state": "failed", "converged": False, "reason": REASON},
    }
    return table


def study_folder(
    folder: Path, table: list[dict[str, Any]] | None = None, study: str = STUDY
) -> Path:
    """The folder of a study with the rows of a table."""
    folder.mkdir(parents=True, exist_ok=True)
    source = folder / "source.yml"
    source.write_text(f"title: {json.dumps(TITLE)}\n{study}", encoding="utf-8")
    parameters = study_file.load(source).parameters
    source.unlink()
    (folder / "parameters.yaml").write_text(study_file.dump(parameters), encoding="utf-8")
    lines = [f"{json.dumps(row, ensure_ascii=False)}\n" for row in table or rows()]
    (folder / "table.jsonl").write_text("".join(lines), encoding="utf-8")
    return folder


def page(folder: Path) -> str:
    """The page that is written into a folder of results."""
    return report.write(folder)[-1].read_text(encoding="utf-8")
