"""``python3 -m contact_locking.view.pictures.window SNAPSHOT``: a window with a solution.

This module is a program of its own, as VTK ends its process if it finds no screen or no OpenGL.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import matplotlib
import pyvista as pv

from contact_locking.view.pictures import snapshot_file, style
from contact_locking.view.pictures.render import Scene, clear, look, set_up, views
from contact_locking.view.pictures.snapshot import Snapshot

_SIZE, _FONT = (1100, 850), "fonts/ttf/DejaVuSans.ttf"
# Pixels to a point, the unit of line widths.
_POINT = 1.4
_LETTERS = 16
_KEYS = "space: next view     q: close     mouse: turn; with Shift: move; wheel: zoom"
# Places are shares of the window.
_SLIDER = {"pointa": (0.7, 0.93), "pointb": (0.96, 0.93), "tube_width": 0.003}
# The largest scale of the slider over the scale at its beginning.
_MOST = 2.0


class Window:
    """A window with the views of a body one after the other, and a slider for the displacement."""

    def __init__(self, body: Snapshot) -> None:
        self._body, self._factor = body, style.magnification(body)
        self._views, self._number = views(body, _LETTERS), 0
        self.plotter: Any = pv.Plotter(
            window_size=_SIZE, title=body.title or "contact_locking", lighting="none"
        )
        set_up(self.plotter)
        self.plotter.add_axes()
        self.plotter.add_key_event("space", self.next)
        self.plotter.add_slider_widget(
            self.scale,
            (0.0, _MOST * self._factor),
            value=self._factor,
            title="displacement times",
            title_height=0.02,
            slider_width=0.015,
            color=style.BLACK,
            fmt="%.3g",
            **_SLIDER,
        )
        self._look()
        self._draw()

    @property
    def title(self) -> str:
        return self._views[self._number].title

    def next(self) -> None:
        """Show the next view; the camera stays if it looks from the same side."""
        before = self._views[self._number].camera
        self._number = (self._number + 1) % len(self._views)
        if self._views[self._number].camera is not before:
            self._look()
        self._draw()

    def scale(self, factor: float) -> None:
        """Draw the displacement ``factor`` times as large."""
        self._factor = factor
        self._draw()

    def _look(self) -> None:
        look(self.plotter, self._views[self._number].camera)

    def _draw(self) -> None:
        plotter = self.plotter
        clear(plotter)
        self._views[self._number].draw(Scene(plotter, self._body, self._factor, _POINT))
        font = str(Path(matplotlib.get_data_path()) / _FONT)
        text = {"color": style.BLACK, "font_file": font, "render": False}
        plotter.add_text(self.title, position="upper_left", font_size=12, **text)
        plotter.add_text(_KEYS, position="lower_left", font_size=8, **text)
        plotter.reset_camera_clipping_range()
        plotter.render()


def main(snapshot: Path) -> None:
    """Show a snapshot file until the window is closed."""
    Window(snapshot_file.load(snapshot)).plotter.show()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
