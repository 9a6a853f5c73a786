"""`contact-locking view`: a window where there is a screen, and clear words everywhere else."""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from report_folder import rows, run_folder, study_folder
from solutions import of_kind

from contact_locking.command import cli
from contact_locking.view.pictures import offscreen, snapshot_file
from contact_locking.view.pictures.gather import gather

pytestmark = pytest.mark.serial

needs_a_screen = pytest.mark.skipif(
    importlib.util.find_spec("pyvista") is None or shutil.which("xvfb-run") is None,
    reason="PyVista or xvfb-run is not installed",
)
# A window is opened and closed as by its keys; what it shows on the way is printed.
WINDOW = """
import sys
from pathlib import Path
import numpy as np
from contact_locking.view.pictures import snapshot_file
from contact_locking.view.pictures.window import Window

for path in sys.argv[1:]:
    window = Window(snapshot_file.load(Path(path)))
    plotter = window.plotter
    plotter.show(interactive=False, auto_close=False)
    keys = plotter.iren.interactor
    first, shown = window.title, []
    while not shown or window.title != first:
        image = plotter.screenshot(return_img=True)
        shown.append((window.title, len(np.unique(image @ [65536, 256, 1])) > 20))
        keys.SetKeyEventInformation(0, 0, " ", 0, "space")
        keys.InvokeEvent("KeyPressEvent")
    before = plotter.screenshot(return_img=True)
    window.scale(0.0)
    print(shown, (plotter.screenshot(return_img=True) != before).any())
    plotter.close()
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run in two dimensions, which nobody changes."""
    return run_folder(tmp_path_factory.mktemp("run"), picture=True)


@pytest.fixture
def own(results: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(results, tmp_path / "run"))


@pytest.fixture(autouse=True)
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)


def refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """The exit code and what is said; nothing in the folder has changed."""
    before = sorted((path, path.stat().st_mtime_ns) for path in folder.rglob("*"))
    code = cli.main(["view", str(folder)])
    output, errors = capsys.readouterr()
    assert output == "" and errors.startswith("error: ")
    assert sorted((path, path.stat().st_mtime_ns) for path in folder.rglob("*")) == before
    return code, errors


def test_without_a_screen_it_says_where_to_look_instead(
    results: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)
    code, errors = refused(results, capsys)
    assert code == 1 and "there is no screen here (DISPLAY is not set)" in errors
    assert f"Look at {results}/picture.png" in errors and "contact-locking report" in errors


def test_without_pyvista_it_says_how_to_install_it(
    results: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    code, errors = refused(results, capsys)
    assert code == 1 and "pip install pyvista" in errors


def test_a_screen_that_does_not_answer_is_one_message(
    results: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":7")
    abort = (sys.executable, "-c", "import os; os.write(2, b'bad screen'); os.abort()")
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)
    monkeypatch.setattr(offscreen, "program", lambda module: abort)
    code, errors = refused(results, capsys)
    assert code == 1 and "no window could be opened: VTK was ended by SIGABRT: bad screen" in errors


def test_a_study_is_refused_with_the_folder_of_a_case(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = study_folder(tmp_path / "study")
    case = folder / "cases" / rows()[0]["case"]
    case.mkdir(parents=True)
    code, errors = refused(folder, capsys)
    assert code == 2 and f"is the folder of a study; give that of a case, such as {case}" in errors


def test_results_of_another_version_are_refused(
    own: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    summary = json.loads((own / "summary.json").read_text()) | {"version": "0.0.1"}
    (own / "summary.json").write_text(json.dumps(summary))
    code, errors = refused(own, capsys)
    assert code == 2 and "holds results of version 0.0.1" in errors


def test_a_folder_without_what_is_to_be_shown_is_refused(
    own: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (own / "snapshot.npz").unlink()
    code, errors = refused(own, capsys)
    assert code == 2 and "solve again with output.picture: true" in errors
    (tmp_path / "empty").mkdir()
    code, errors = refused(tmp_path / "empty", capsys)
    assert code == 2 and "holds no results" in errors
    code, errors = refused(tmp_path / "missing", capsys)
    assert code == 2 and "there is no such folder" in errors


@needs_a_screen
def test_on_a_screen_a_window_is_opened(results: Path) -> None:
    # PyVista's own setting for tests: the window closes at once.
    environment = offscreen.environment() | {"PYVISTA_OFF_SCREEN": "true"}
    words = [*offscreen.XVFB, sys.executable, "-m", "contact_locking", "view", str(results)]
    done = subprocess.run(
        words, env=environment, capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.slow
@needs_a_screen
def test_the_window_shows_view_after_view_and_any_scale(results: Path, tmp_path: Path) -> None:
    snapshots = [str(results / "snapshot.npz")]
    for kind in ("locked", "with two contacts"):
        body = gather(of_kind(3, kind))
        assert body is not None
        snapshots.append(str(tmp_path / f"{kind}.npz"))
        snapshot_file.save(body, Path(snapshots[-1]))
    done = subprocess.run(
        [*offscreen.XVFB, sys.executable, "-c", WINDOW, *snapshots],
        env=offscreen.environment(),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    titles = [
        "Deformed body, |ε(u)| / M",
        "Cut open, |ε(u)| / M",
        "Cells at the strain limit, |ε(u)| ≥ M",
    ]
    titles += ["Contact pressure", "Open, stick and slip"]
    in_plane = [title for title in titles if "Cut" not in title]
    of_two = [f"{title}: {name}" for name in ("bottom", "left, a $part$") for title in titles[3:]]
    kinds = (in_plane, titles, titles[:3] + of_two)
    shown = [f"{[(title, True) for title in kind]} True\n" for kind in kinds]
    assert done.stdout == "".join(shown)
