"""``python3 -m contact_locking.plotting.render SNAPSHOT VIEWS SECONDS``: views as pictures.

This module is a program of its own, as VTK ends its process if it finds no screen or no OpenGL.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np

from contact_locking.plotting import snapshot_file, style
from contact_locking.plotting.camera import Camera
from contact_locking.plotting.snapshot import Snapshot
from contact_locking.plotting.views import BODY, CUT, LOCKED, Image, View, views

# Pictures are drawn larger by this factor and then reduced, which makes edges smooth.
_FINER = 3
_INCH = 72.0
# Lines move towards the viewer by this share of the body's size.
_LIFT = 0.005


def render(body: Snapshot) -> dict[str, Image]:
    """Pictures (h, w, 3) of all views by name."""
    import pyvista as pv

    plotter = pv.Plotter(off_screen=True, lighting="none")
    set_up(plotter)
    try:
        # All views use one plotter: an X server without clients may end.
        return {name: _picture(plotter, body, name, view) for name, view in views(body).items()}
    finally:
        plotter.close()


def _picture(plotter: Any, body: Snapshot, name: str, view: View) -> Image:
    from contact_locking.plotting.scene import Scene

    plotter.clear_actors()
    plotter.window_size = [_FINER * round(style.DPI * size) for size in (view.width, view.height)]
    point = style.DPI * _FINER / _INCH
    lift = _LIFT * body.size * view.camera.towards
    scene = Scene(plotter, body, style.magnification(body), point, lift)
    if name == BODY:
        scene.deformed_body()
    elif name == CUT:
        scene.cut_open()
    elif name == LOCKED:
        scene.locked_zone()
    else:
        scene.pressure()
    look(plotter, view.camera)
    plotter.render()
    return _coarser(np.asarray(plotter.screenshot(return_img=True))[..., :3])


def set_up(plotter: Any) -> None:
    """Set the background and the light of a plotter, and allow bodies of glass."""
    import pyvista as pv

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


def main(snapshot: Path, target: Path, seconds: int) -> None:
    """Render the views of a snapshot file into a file of NumPy."""
    # If a graphics driver hangs, the process that has started this one may be gone.
    signal.alarm(seconds)
    images: dict[str, Any] = dict(render(snapshot_file.load(snapshot)))
    with target.open("wb") as stream:
        np.savez(stream, **images)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
