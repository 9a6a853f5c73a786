"""``python3 -m contact_locking.plotting.render SOURCE VIEWS SECONDS``: views as pictures.

SOURCE is the file of a snapshot, or a folder with the snapshots of a film.  This module is a
program of its own, as VTK ends its process if it finds no screen or no OpenGL.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self

import numpy as np
import pyvista as pv

from contact_locking.plotting import snapshot_file, style
from contact_locking.plotting.camera import Camera
from contact_locking.plotting.film_look import FILM_DPI, FILM_WIDTH, look_of
from contact_locking.plotting.scene import Scene
from contact_locking.plotting.snapshot import Snapshot
from contact_locking.plotting.views import (
    BODY,
    CUT,
    LOCKED,
    Image,
    View,
    side_view,
    views,
)

# Pictures are drawn larger by this factor and then reduced, which makes edges smooth.
_FINER = 3
_INCH = 72.0
# Lines move towards the viewer by this share of the body's size.
_LIFT = 0.005

# The views that are not those of a contact.
_VIEWS: dict[str, Callable[[Scene], None]] = {
    BODY: Scene.deformed_body,
    CUT: Scene.cut_open,
    LOCKED: Scene.locked_zone,
}


def render(body: Snapshot) -> dict[str, Image]:
    """Pictures (h, w, 3) of all views by name."""
    factor = style.magnification(body)
    with _Painter(style.DPI) as painter:
        return {
            name: painter.picture(body, factor, view, _VIEWS.get(name, Scene.pressure))
            for name, view in views(body).items()
        }


def render_film(bodies: Sequence[Snapshot]) -> Iterator[Image]:
    """The pictures (h, w, 3) of the deformed bodies of a film."""
    common = look_of(bodies)
    view = side_view(bodies, common.factor, FILM_WIDTH)
    with _Painter(FILM_DPI) as painter:
        for body, shade in zip(bodies, common.shades, strict=True):
            yield painter.picture(body, common.factor, view, Scene.deformed_body, shade)


class _Painter:
    """Draws pictures of ``dpi`` pixels to an inch with one plotter; a context manager.

    All pictures use one plotter: an X server without clients may end.
    """

    def __init__(self, dpi: int) -> None:
        self._dpi = dpi
        self._plotter: Any = pv.Plotter(off_screen=True, lighting="none")
        set_up(self._plotter)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._plotter.close()

    def picture(
        self,
        body: Snapshot,
        factor: float,
        view: View,
        draw: Callable[[Scene], None],
        shade: style.Shade | None = None,
    ) -> Image:
        plotter = self._plotter
        plotter.clear_actors()
        plotter.window_size = [_FINER * round(self._dpi * s) for s in (view.width, view.height)]
        point = self._dpi * _FINER / _INCH
        draw(Scene(plotter, body, factor, point, _LIFT * body.size * view.camera.towards, shade))
        look(plotter, view.camera)
        plotter.render()
        return _coarser(np.asarray(plotter.screenshot(return_img=True))[..., :3])


def set_up(plotter: Any) -> None:
    """Set the background and the light of a plotter, and allow bodies of glass."""
    plotter.set_background("white")
    plotter.add_light(pv.Light(position=(-0.5, 0.9, 1.4), light_type="camera light"))
    # Depth peeling, which glass takes, does not work with several samples for each pixel.
    plotter.render_window.SetMultiSamples(0)
    plotter.enable_depth_peeling()


def look(plotter: Any, camera: Camera) -> None:
    """Set the camera of a plotter."""
    distance = 10.0 * max(camera.width, camera.height)
    plotter.camera.position = camera.centre + distance * camera.towards
    plotter.camera.focal_point = camera.centre
    plotter.camera.up = camera.up
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = 0.5 * camera.height
    plotter.reset_camera_clipping_range()


def _coarser(image: Image) -> Image:
    """The mean over squares of pixels."""
    steps = range(_FINER)
    total = sum(image[i::_FINER, j::_FINER].astype(np.uint16) for i in steps for j in steps)
    return np.asarray(total // _FINER**2, dtype=np.uint8)


def main(source: Path, target: Path, seconds: int) -> None:
    """Render the views of a snapshot, or the frames of a film, into a file of NumPy."""
    # If a graphics driver hangs, the process that has started this one may be gone.
    signal.alarm(seconds)
    if source.is_dir():
        files = sorted(source.iterdir())
        drawn = render_film([snapshot_file.load(file) for file in files])
        images: dict[str, Any] = dict(zip((file.stem for file in files), drawn, strict=True))
    else:
        images = dict(render(snapshot_file.load(source)))
    with target.open("wb") as stream:
        np.savez(stream, **images)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
