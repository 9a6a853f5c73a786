"""A figure on which things are placed in inches from its upper left corner."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from contact_locking.plotting import style
from contact_locking.plotting.camera import Camera
from contact_locking.plotting.snapshot import FloatArray
from contact_locking.plotting.views import Image, View

Place = tuple[float, float, float, float]

# Inches: of titles above and scales of colours below what they belong to.
_ABOVE, _BELOW, _THICK, _INSET = 0.1, 0.14, 0.1, 0.1
# The arrows along the axes as a share of what is seen; those that point at the viewer are left out.
_ARROW, _SHORTEST = 0.13, 0.35
# Width and height of the line that says how long they are, in inches.
_NOTE = (0.75, 0.15)
_WHITE = 255
_HALO = [withStroke(linewidth=2.5, foreground="white")]


class Page:
    """A figure of a size in inches; ``left`` and ``top`` are distances from its corner."""

    def __init__(self, width: float, height: float) -> None:
        self.figure = Figure(figsize=(width, height))
        self._width, self._height = width, height

    def place(self, left: float, top: float, width: float, height: float) -> Place:
        """A rectangle as shares of the figure, as Matplotlib has them."""
        bottom = self._height - top - height
        return left / self._width, bottom / self._height, width / self._width, height / self._height

    def text(self, left: float, top: float, text: str, **how: Any) -> None:
        """A line of text that ends at ``top`` or is centred there, as ``va`` says."""
        self.figure.text(left / self._width, 1.0 - top / self._height, text, **how)

    def view(self, view: View, image: Image, left: float, top: float, title: str) -> Axes:
        """A drawn view with its title; the axes count inches from its lower left corner."""
        size = (view.width, view.height)
        axes = self.figure.add_axes(self.place(left, top, *size))
        axes.set_axis_off()
        axes.imshow(image, extent=(0.0, size[0], 0.0, size[1]))
        axes.set(xlim=(0.0, size[0]), ylim=(0.0, size[1]))
        self.text(left, top - _ABOVE, title, fontsize=10.5)
        _arrows_along_axes(axes, image, view.camera)
        return axes

    def bar(
        self,
        colours: ScalarMappable,
        left: float,
        top: float,
        width: float,
        extend: str = "neither",
        label: str = "",
    ) -> None:
        """A scale of colours below ``top``, and to its right what it is of."""
        bar = self.figure.add_axes(self.place(left + _INSET, top + _BELOW, width, _THICK))
        self.figure.colorbar(colours, cax=bar, orientation="horizontal", extend=extend)
        bar.locator_params(nbins=4)
        end = (left + _INSET + width + 2 * _INSET, top + _BELOW + 0.5 * _THICK)
        self.text(*end, label, va="center")

    def legend(self, handles: Sequence[Any], left: float, top: float) -> None:
        """A legend in a row, at the height of the scales."""
        anchor = (left / self._width, 1.0 - (top + _BELOW + 0.5 * _THICK) / self._height)
        self.figure.legend(
            handles=list(handles),
            loc="center left",
            bbox_to_anchor=anchor,
            ncols=len(handles),
            borderpad=0.0,
            borderaxespad=0.0,
            columnspacing=1.4,
        )


def _arrows_along_axes(axes: Axes, image: Image, camera: Camera) -> None:
    """Arrows of a round length along x, y and z in the corner where most of the view is empty."""
    width = float(axes.get_xlim()[1])
    length = style.round_below(_ARROW * camera.width)
    arrows = length * width / camera.width * np.column_stack([camera.right, camera.up])
    shown = np.hypot(*arrows.T) > _SHORTEST * np.hypot(*arrows.T).max()
    names, arrows = np.array(list("xyz"))[shown], arrows[shown]
    # Room for the letters, and above or below them for the note.
    low = np.minimum(arrows.min(axis=0), 0.0) - 0.16
    high = np.maximum(arrows.max(axis=0), 0.0) + 0.2
    high[0] = max(high[0], low[0] + _NOTE[0])
    note = np.array([0.0, _NOTE[1]])
    corner = _emptiest_corner(image, (high - low + note) / width)
    outwards = np.where(corner > 0.5, high + note, low - note)
    origin = corner * (width, float(axes.get_ylim()[1])) - outwards
    look = {"arrowstyle": "-|>", "lw": 1.0, "shrinkA": 0, "shrinkB": 0, "color": style.BLACK}
    for name, arrow in zip(names, arrows, strict=True):
        axes.annotate("", origin + arrow, origin, arrowprops=look | {"path_effects": _HALO})
        x, y = origin + arrow + 0.1 * arrow / np.linalg.norm(arrow)
        axes.text(x, y, f"${name}$", ha="center", va="center", path_effects=_HALO)
    x, y = origin[0] + low[0] + 0.08, high[1] if corner[1] > 0.5 else low[1] - _NOTE[1]
    text = f"axes: {length:g}"
    axes.text(x, origin[1] + y + 0.04, text, fontsize=7.5, color=style.GREY, path_effects=_HALO)


def _emptiest_corner(image: Image, size: FloatArray) -> FloatArray:
    """The corner (2,), as 0 or 1 in each direction, of an image in which most pixels are white.

    ``size`` (2,) is that of the part in the corner, as shares of the width.
    """
    across, down = np.ceil(size * image.shape[1]).astype(int)
    corners = {
        (0.0, 0.0): image[-down:, :across],
        (0.0, 1.0): image[:down, :across],
        (1.0, 0.0): image[-down:, -across:],
        (1.0, 1.0): image[:down, -across:],
    }
    return np.array(max(corners, key=lambda corner: np.mean(corners[corner] == _WHITE)))
