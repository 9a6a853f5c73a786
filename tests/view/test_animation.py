"""The animation of a process: a GIF file, and a slider over its frames in the report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import browser
import numpy as np
import pytest
from mpi4py import MPI
from PIL import Image
from problems import block
from slow import slow
from solutions import of_kind

from contact_locking.errors import NoRendering
from contact_locking.running.process import run_steps
from contact_locking.study_file.parameters import Parameters
from contact_locking.view import report
from contact_locking.view.pictures import offscreen, style
from contact_locking.view.pictures.animation import MOST_FRAMES, Film, Frame, animation
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.snapshot import ContactMap, Snapshot, seen_from_outside
from contact_locking.view.pictures.style import look_of
from contact_locking.view.report.pictures import frames

TIMES = [0.5, 1.0, 2.0]


def process(dim: int = 2, **output: Any) -> Parameters:
    """A small block that is pressed more and more."""
    loads = {
        "pressures": [{"on": "top", "value": "0.02*t"}],
        "displacements": [{"on": "left", "value": [0] * dim}],
    }
    wanted = {"fields": False, "picture": True} | output
    return block(dim, 0.5, loads=loads, steps={"times": TIMES}, output=wanted)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a run of the process, with its report."""
    place: Path = MPI.COMM_WORLD.bcast(tmp_path_factory.mktemp("process"))
    run_steps(process(), place)
    if MPI.COMM_WORLD.rank == 0:
        report.write(place)
    MPI.COMM_WORLD.barrier()
    return place


def flat_body(shift: float = 0.0) -> Snapshot:
    """A triangle, displaced along x."""
    x = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    return Snapshot(
        x=x,
        displacement=np.full_like(x, shift),
        cells=np.array([[0, 1, 2]]),
        boundary=np.array([[0, 1], [1, 2], [2, 0]]),
        boundary_cell=np.zeros(3, dtype=np.int64),
        strain_norm=np.array([shift]),
        locking_limit=np.array([np.inf]),
        locked=np.array([False]),
        contact=ContactMap.none(2),
        title="",
        dofs=6,
        locked_fraction=0.0,
        converged=True,
    )


def test_a_process_leaves_an_animation_with_the_times_of_its_steps(folder: Path) -> None:
    with Image.open(folder / "animation.gif") as opened:
        facts = json.loads(opened.info["comment"])
        assert getattr(opened, "n_frames", 1) == len(TIMES)
        images = []
        for number in range(len(TIMES)):
            opened.seek(number)
            images.append(np.asarray(opened.convert("RGB")))
    assert facts == {"steps": [1, 2, 3], "times": TIMES}
    assert not np.array_equal(images[0], images[-1])


@pytest.mark.serial
@pytest.mark.parametrize("output", [{"animation": False}, slow({"picture": False})])
def test_an_animation_that_nobody_wants_is_not_drawn(
    output: dict[str, bool], tmp_path: Path
) -> None:
    # That of an earlier run goes.
    run_steps(process(), tmp_path)
    assert (tmp_path / "animation.gif").exists()
    run_steps(process(**output), tmp_path)
    assert (tmp_path / "history.csv").exists()
    assert not (tmp_path / "animation.gif").exists()


@pytest.mark.serial
@pytest.mark.parametrize("count", [1, 2, MOST_FRAMES, 41, 200, 1000])
def test_a_film_has_few_frames_equally_far_apart_and_the_last(count: int) -> None:
    film, body = Film(), flat_body()
    for step in range(1, count + 1):
        film.add(Frame(step, float(step), body))
    steps = [frame.step for frame in film.frames]
    assert steps[0] == 1
    assert steps[-1] == count
    assert len(steps) <= MOST_FRAMES
    assert len(steps) >= min(count, MOST_FRAMES // 2)
    assert len(set(np.diff(steps[:-1]))) <= 1


@pytest.mark.serial
def test_the_mesh_of_a_film_is_in_memory_once() -> None:
    film = Film()
    for step in (1, 2):
        film.add(Frame(step, float(step), flat_body(0.1 * step)))
    first, second = (frame.body for frame in film.frames)
    assert second.x is first.x


@pytest.mark.serial
def test_equal_frames_stay_frames_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "animation.gif"
    path.write_bytes(animation([Frame(step, 0.1 * step, flat_body(0.2)) for step in (1, 2, 3)]))
    assert [frame.caption for frame in frames(path)] == [f"t = 0.{k}, step {k}" for k in (1, 2, 3)]


@pytest.mark.serial
def test_a_page_with_a_damaged_animation_has_no_slider(folder: Path, tmp_path: Path) -> None:
    whole = (folder / "animation.gif").read_bytes()
    facts = json.dumps({"steps": [1, 2, 3], "times": TIMES}).encode()
    assert facts in whole
    path = tmp_path / "animation.gif"
    for content in (
        b"",
        b"GIF89a",
        whole[: len(whole) // 2],
        whole.replace(facts, b"[" * len(facts)),
        whole.replace(b"0.5, 1.0", b"NaN, 1.0"),
        whole.replace(b"[1, 2, 3]", b"[1, 2   ]"),
    ):
        path.write_bytes(content)
        assert frames(path) == []
    assert frames(None) == []
    assert len(frames(folder / "animation.gif")) == 3


# In three dimensions ------------------------------------------------------------------------------


def solid_body(scale: float = 1.0) -> Snapshot:
    """The locked block of the pictures, with strain and displacement scaled."""
    body = gather(of_kind(3, "locked"))
    assert body is not None
    strain, displacement = scale * body.strain_norm, scale * body.displacement
    return replace(body, strain_norm=strain, displacement=displacement)


def test_a_process_in_space_has_no_animation_where_nothing_can_render(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, comm: MPI.Intracomm
) -> None:
    def fail(source: Path) -> dict[str, Any]:
        raise NoRendering("there is no screen")

    monkeypatch.setattr(offscreen, "views", fail)
    place = comm.bcast(tmp_path)
    solution, _ = run_steps(process(3), place)
    assert "no animation was drawn: there is no screen" in solution.summary["warnings"]
    comm.Barrier()
    assert not (place / "animation.gif").exists() and (place / "history.csv").exists()


@pytest.mark.serial
def test_a_film_in_space_keeps_the_cells_that_touch_the_surface() -> None:
    body = solid_body()
    skin = seen_from_outside(body)
    assert len(skin.cells) < len(body.cells)
    for name in ("boundary", "contact.vertices"):
        before, after = (attrgetter(name)(one) for one in (body, skin))
        assert np.array_equal(skin.x[after], body.x[before])
        assert np.array_equal(skin.displacement[after], body.displacement[before])
        # The line around the locked zone stays where it is.
        shares = style.locked_share(skin)[after], style.locked_share(body)[before]
        assert np.array_equal(*shares)
    for name in ("strain_norm", "locking_limit", "locked"):
        before, after = (getattr(one, name)[one.boundary_cell] for one in (body, skin))
        assert np.array_equal(after, before)
    flat = flat_body()
    assert seen_from_outside(flat) is flat


@pytest.mark.serial
def test_the_frames_of_a_film_share_magnification_scale_and_palette(tmp_path: Path) -> None:
    bodies = [solid_body(scale) for scale in (0.25, 1.0)]
    look = look_of(bodies)
    assert look.factor == style.magnification(bodies[1])
    assert {shade.norm.vmax for shade in look.shades} == {1.0}
    path = tmp_path / "animation.gif"
    path.write_bytes(animation([Frame(step, 0.1 * step, flat_body(0.1 * step)) for step in (1, 2)]))
    bars = []
    with Image.open(path) as opened:
        assert opened.getpalette() is not None
        for number in range(2):
            opened.seek(number)
            image = np.asarray(opened.convert("RGB"))
            bars.append(image[:, -image.shape[1] // 6 :])
        assert opened.tell() == 1
    # The scale of colours is at the right, and the same in both.
    assert np.ptp(bars[0].astype(int), axis=-1).max() > 100
    assert np.array_equal(bars[0], bars[1])


# The page in a browser ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[browser.Browser]:
    with browser.Browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.mark.serial
@pytest.mark.skipif(browser.PROGRAM is None, reason="there is no Chromium on the PATH")
def test_the_slider_shows_each_step_by_mouse_and_keys_and_asks_for_nothing(
    folder: Path, tab: browser.Browser
) -> None:
    def shown() -> Any:
        images = "[...document.querySelectorAll('#film img')].filter(i => !i.hidden)"
        visible = f"{images}.map(i => [i.dataset.caption, i.clientWidth > 100])"
        told = "document.getElementById('shown-frame').textContent"
        return tab.evaluate(f"[{visible}, {told}]")

    def press(key: str) -> None:
        for kind in ("keyDown", "keyUp"):
            tab.call("Input.dispatchKeyEvent", type=kind, key=key, code=key, **CODES[key])

    page = folder / "report.html"
    tab.open(page)
    last, first = "t = 2, step 3", "t = 0.5, step 1"
    assert shown() == [[[last, True]], last]
    tab.evaluate("document.getElementById('frame').focus()")
    press("ArrowLeft")
    assert shown()[1] == "t = 1, step 2"
    press("Home")
    assert shown() == [[[first, True]], first]
    assert tab.evaluate("document.getElementById('frame').getAttribute('aria-valuetext')") == first
    # To the end by the button, where the film stops.
    tab.evaluate("document.getElementById('play').click()")
    wait = "new Promise(done => setTimeout(done, 900))"
    tab.evaluate(wait)
    assert shown() == [[[last, True]], last]
    assert tab.evaluate("document.getElementById('play').textContent") == "Play"
    assert [url for url in tab.requests if not url.startswith("data:")] == [page.as_uri()]
    assert tab.complaints == []


CODES: dict[str, dict[str, int]] = {
    "ArrowLeft": {"windowsVirtualKeyCode": 37},
    "Home": {"windowsVirtualKeyCode": 36},
}
