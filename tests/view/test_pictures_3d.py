"""Pictures in three dimensions: with PyVista, and where PyVista cannot draw."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import numpy.typing as npt
import pytest
from mpi4py import MPI
from problems import block
from solutions import made_up, of_kind, snapshot
from tool_files import box

from contact_locking import solve, solve_steps
from contact_locking.arrays import BoolArray
from contact_locking.errors import NoRendering
from contact_locking.running import run as writing
from contact_locking.view.pictures import space, style
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.style import drawn_tool, save

Image = npt.NDArray[np.uint8]

needs_pyvista = pytest.mark.skipif(
    importlib.util.find_spec("pyvista") is None or shutil.which("xvfb-run") is None,
    reason="PyVista or xvfb-run is not installed",
)
TEXTS = {"summary.json", "parameters.yaml", "contact.csv", "contact_facets.csv"}
FILES = TEXTS | {"picture.png"}
ABORT = "import os; os.abort()"
RENDER_ALL = """
import sys
from pathlib import Path
from contact_locking.view.pictures import render
for folder in map(Path, sys.argv[1:]):
    render.main(folder / "snapshot", folder / "views.npz", 60)
"""


#: A block that touches its foundation with a whole side.
HEXAHEDRA = block(
    3,
    h=0.5,
    mesh__structured=True,
    mesh__cells="box",
    loads={"displacements": [{"on": "top", "value": [0.0, 0.0, -0.01]}]},
)
DRAWN = ("locked", "without contact", "partly unlimited", "at rest", "with two contacts")


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Image]]:
    """The views of every kind of body, from one process."""
    bodies = {kind: snapshot(3, kind) for kind in DRAWN}
    pressed = gather(solve(HEXAHEDRA))
    assert pressed is not None
    bodies["hexahedra"] = pressed
    folders = {kind: tmp_path_factory.mktemp("kind") for kind in bodies}
    for kind, body in bodies.items():
        save(body, folders[kind] / "snapshot")
    words = [*space.XVFB, sys.executable, "-c", RENDER_ALL, *map(str, folders.values())]
    subprocess.run(words, env=space.environment(), timeout=120, check=True)
    found = {}
    for kind, folder in folders.items():
        with np.load(folder / "views.npz") as images:
            found[kind] = dict(images)
    return found


def hue(image: Image, colour: tuple[float, float, float]) -> BoolArray:
    """Where a picture has a colour, in any light and behind glass."""
    parts = image.astype(float) / (image.astype(float).sum(axis=-1, keepdims=True) + 1e-9)
    return np.linalg.norm(parts - np.array(colour) / sum(colour), axis=-1) < 0.1


VERMILION, BLUE = (0xD5, 0x5E, 0x00), (0x00, 0x72, 0xB2)


LOCKED = "Cells at the strain limit, |ε(u)| ≥ M"
CONTACT = ("Contact pressure", "Open, stick and slip")


@pytest.mark.serial
@needs_pyvista
@pytest.mark.parametrize("kind", DRAWN)
def test_every_view_of_every_kind_of_body_shows_something(
    kind: str, drawn: dict[str, dict[str, Image]]
) -> None:
    at_rest = kind == "at rest"
    strain = "|ε(u)|" if at_rest else "|ε(u)| / M"
    wanted = {f"Deformed body, {strain}", f"Cut open, {strain}"} | set(() if at_rest else [LOCKED])
    names = {"without contact": [], "with two contacts": [": bottom", ": left, a $part$"]}
    wanted |= {f"{title}{name}" for title in CONTACT for name in names.get(kind, [""])}
    assert set(drawn[kind]) == wanted
    for image in drawn[kind].values():
        assert image.shape == (600, 800, 3)
        assert 0.1 < np.mean((image < 254).any(axis=-1)) < 0.95
        assert image.std() > 20.0 or at_rest


@needs_pyvista
def test_the_picture_of_a_run_is_made_of_views(tmp_path: Path, comm: MPI.Intracomm) -> None:
    folder = comm.bcast(tmp_path)
    assert writing.write(made_up(3, output={"fields": False}), folder) == []
    if comm.rank == 0:
        assert {path.name for path in folder.iterdir()} == FILES
        image = matplotlib.image.imread(folder / "picture.png")
        assert min(image.shape[:2]) > 1000
        # The solid zone: that large in no other picture.
        assert hue((255 * image[:, :, :3]).astype(np.uint8), VERMILION).mean() > 0.03


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Replace the program that draws by another one, without a screen."""
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: True)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setenv("DISPLAY", ":0")

    def replace(code: str) -> None:
        program = (sys.executable, "-c", code)
        monkeypatch.setattr(space, "_PROGRAM", program)

    return replace


@pytest.mark.serial
@pytest.mark.parametrize(
    ("code", "told"),
    [
        (ABORT, "VTK ended with exit code -6"),
        (
            "import os, signal; os.kill(os.getpid(), signal.SIGKILL)",
            "-9: is there a screen?",
        ),
        ("raise RuntimeError('no OpenGL')", "exit code 1: RuntimeError: no OpenGL"),
        ("import sys; open(sys.argv[2], 'w').write('no pictures')", "Error: "),
    ],
)
def test_a_program_that_cannot_draw_leaves_everything_else_intact(
    code: str, told: str, stand_in: Any, tmp_path: Path, comm: MPI.Intracomm
) -> None:
    stand_in(code)
    folder = comm.bcast(tmp_path)
    (warning,) = writing.write(made_up(3, output={"fields": False}), folder)
    assert warning.startswith("no picture was drawn: ") and told in warning
    comm.Barrier()
    assert {path.name for path in folder.iterdir()} == FILES - {"picture.png"}


@pytest.mark.serial
def test_a_program_that_hangs_is_ended_with_all_it_has_started(
    stand_in: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pid = tmp_path / "pid"
    sleep = "import subprocess as s; p = s.Popen(['sleep', '60'])"
    stand_in(f"{sleep}; open({str(pid)!r}, 'w').write(str(p.pid)); p.wait()")
    monkeypatch.setattr(space, "_SECONDS", 1)
    monkeypatch.setattr(space, "_GRACE_SECONDS", 0.5)
    with pytest.raises(NoRendering, match="not finished in 1 seconds"):
        space.views(snapshot())
    end = time.monotonic() + 5.0
    while _runs(int(pid.read_text())):
        assert time.monotonic() < end
        time.sleep(0.02)


def _runs(pid: int) -> bool:
    """Whether a process is there and has not ended, though nobody may have asked how."""
    try:
        status = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


@pytest.mark.serial
def test_a_tool_of_any_shape_is_drawn_where_motion_and_force_have_brought_it() -> None:
    disc = {"sphere": {"centre": [0.5, -0.52], "radius": 0.5}, "motion": [0.1, "0.01*t"]}
    pushed = {"sphere": {"centre": [0.5, 1.55], "radius": 0.5}, "force": [0.0, -0.01]}
    contact = [{"on": "bottom", "foundation": disc}, {"on": "top", "foundation": pushed}]
    loads = {"displacements": [{"on": "left", "value": [0, 0]}]}
    given = block(2, 0.25, contact=contact, loads=loads, steps={"times": [0.5, 1.0]})
    *_, last = solve_steps(given)
    body = gather(last)
    assert body is not None
    travel = last.contacts[1].contact.travel
    assert travel[1] < -0.04
    for facets, centre in zip(
        body.contact.tools, ([0.6, -0.51], [0.5, 1.55 + travel[1]]), strict=True
    ):
        ends = facets.reshape(-1, 2)
        assert np.linalg.norm(ends - centre, axis=1) == pytest.approx(0.5, abs=1e-4)


@pytest.mark.serial
def test_a_small_tool_is_drawn_as_a_whole_and_a_large_one_as_ground() -> None:
    small, large = box([0.3, 0.3, -0.5], [0.7, 0.7, 0.0]), box([-9, -9, -1], [9, 9, 0])
    x = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    assert len(drawn_tool(small, x)) == 12 and len(drawn_tool(large, x)) == 0
    body = gather(of_kind(3, "locked"))
    assert body is not None
    (part,) = body.contact.parts()
    assert len(style.foundation(replace(part, tools=(small,)), 1.0, 1.0)) == 12
    assert len(style.foundation(part, 1.0, 1.0)) == 1
