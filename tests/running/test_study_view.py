"""The view of a running study, and the sources of its numbers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import cast

import pytest
from rich.console import Console
from study_folder import Folder

from contact_locking.running.cases import Case, Outcome
from contact_locking.running.executor import Slot
from contact_locking.running.runner import Study, View

pytestmark = pytest.mark.serial


def test_a_terminal_shows_what_runs_and_how_far_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = Folder(tmp_path, monkeypatch)
    folder.write("{vary: {penalty.n: [10, 3, 30]}}")
    study = Study.of(folder.load())
    for case in study.cases:
        case.folder.mkdir(parents=True)
    log = "computing\n  stage 1/1  n = 30  iteration 7, residual 1.0e-03\n"
    (study.cases[2].folder / "log.txt").write_text(log)
    with View(Console(force_terminal=True, width=100), 3) as view:
        warned = {"warnings": ["the strain is large", "no picture"]}
        view.ended(study.cases[0], Outcome("converged", summary=warned), 30.0)
        view.ended(study.cases[1], Outcome("not converged", "[too] steep"), 50.0)
        view.show([cast(Slot, Started(study.cases[2], 10.0))])
        shown = capsys.readouterr().out
    assert "[1/3] penalty.n = 10  converged  (30 s)" in shown
    assert "warning: the strain is large" in shown and "warning: no picture" in shown
    assert "[2/3] penalty.n = 3  not converged: [too] steep  (50 s)" in shown
    assert "2 of 3 done, 1 running, 1 not converged" in shown
    assert "penalty.n = 30    stage 1/1  n = 30  iteration 7, residual 1.0e-03    10 s" in shown


@dataclass
class Started:
    case: Case
    seconds: float
