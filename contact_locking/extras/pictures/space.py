"""The picture of a body in three dimensions: a sheet with views that PyVista has drawn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from contact_locking.arrays import FloatArray
from contact_locking.extras.pictures import contact_map, style
from contact_locking.extras.pictures.snapshot import ContactMap, Snapshot
from contact_locking.extras.pictures.style import FILM_WIDTH, Look
from contact_locking.extras.pictures.views import (
    BODY,
    CUT,
    LOCKED,
    WIDTH,
    Camera,
    Image,
    View,
    contact_view,
    side_view,
    views,
)
from contact_locking.results.contact_points import STICK

Place = tuple[float, float, float, float]

# Inches: titles above a view, and scales of colours below a view.
_ABOVE, _UNDER, _THICK, _INSET = 0.1, 0.14, 0.1, 0.1
# The length of the arrows along the axes as a share of the view's width, and the share of the
# longest arrow below which an arrow is left out, as it points at the viewer.
_ARROW, _SHORTEST = 0.13, 0.35
# Width and height of the note with the length of the arrows, in inches.
_NOTE = (0.75, 0.15)
_WHITE = 255
_HALO = [withStroke(linewidth=2.5, foreground="white")]


class Sheet:
    """A figure of a size in inches; ``left`` and ``top`` are distances from its corner."""

    def __init__(self, width: float, height: float) -> None:
        self.figure = Figure(figsize=(width, height))
        self._width, self._height = width, height

    def place(self, left: float, top: float, width: float, height: float) -> Place:
        """A rectangle as shares of the figure, as Matplotlib takes rectangles."""
        bottom = self._height - top - height
        return left / self._width, bottom / self._height, width / self._width, height / self._height

    def text(self, left: float, top: float, text: str, **how: Any) -> None:
        """Add a line of text, whose vertical place at ``top`` is as ``va`` says."""
        self.figure.text(left / self._width, 1.0 - top / self._height, text, **how)

    def view(
        self,
        view: View,
        image: Image,
        left: float,
        top: float,
        title: str,
        shown: Image | None = None,
    ) -> Axes:
        """Add a view with its title; the axes count inches from the view's lower left corner.

        The arrows along x, y and z stand where ``shown``, by default the image, is white.
        """
        size = (view.width, view.height)
        axes = self.figure.add_axes(self.place(left, top, *size))
        axes.set_axis_off()
        axes.imshow(image, extent=(0.0, size[0], 0.0, size[1]))
        axes.set(xlim=(0.0, size[0]), ylim=(0.0, size[1]))
        self.text(left, top - _ABOVE, title, fontsize=10.5)
        _arrows_along_axes(axes, image if shown is None else shown, view.camera)
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
        """Add a scale of colours below ``top``, with a label below its numbers."""
        bar = self.figure.add_axes(self.place(left + _INSET, top + _UNDER, width, _THICK))
        self.figure.colorbar(colours, cax=bar, orientation="horizontal", extend=extend)
        bar.locator_params(nbins=4)
        bar.set_xlabel(label, loc="left", labelpad=2.0)

    def legend(
        self, handles: Sequence[Any], left: float, top: float, in_a_row: bool = True
    ) -> None:
        """Add a legend whose first row is at the height of the scales."""
        anchor = (left / self._width, 1.0 - (top + _UNDER - 0.4 * _THICK) / self._height)
        self.figure.legend(
            handles=list(handles),
            loc="upper left",
            bbox_to_anchor=anchor,
            ncols=max(len(handles), 1) if in_a_row else 1,
            borderpad=0.0,
            borderaxespad=0.0,
            columnspacing=1.4,
        )


def _arrows_along_axes(axes: Axes, image: Image, camera: Camera) -> None:
    """Draw arrows of a round length along x, y and z in the emptiest corner of a view."""
    width = float(axes.get_xlim()[1])
    length = style.round_below(_ARROW * camera.width)
    arrows = length * width / camera.width * np.column_stack([camera.right, camera.up])
    shown = np.hypot(*arrows.T) > _SHORTEST * np.hypot(*arrows.T).max()
    names, arrows = np.array(list("xyz"))[shown], arrows[shown]
    # The letters take room at the arrows, the note above or below the letters.
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
    """The corner (2,) of an image with the most white pixels, as 0 or 1 in each direction.

    ``size`` (2,) is the size of the part that is looked at, as shares of the image's width.
    """
    across, down = np.ceil(size * image.shape[1]).astype(int)
    corners = {
        (0.0, 0.0): image[-down:, :across],
        (0.0, 1.0): image[:down, :across],
        (1.0, 0.0): image[-down:, -across:],
        (1.0, 1.0): image[:down, -across:],
    }
    return np.array(max(corners, key=lambda corner: np.mean(corners[corner] == _WHITE)))


# Inches: margins, the head of the sheet, a title, and the scale or the legend below a view.
_MARGIN, _HEAD, _TITLE, _BELOW = 0.2, 0.8, 0.3, 0.8
_LEFT, _RIGHT = _MARGIN, WIDTH + 2 * _MARGIN
# A scale of colours, and the numbers at the axes of a map.
_BAR, _NUMBERS = 1.6, 0.5


def figure(body: Snapshot, images: Mapping[str, Image]) -> Figure:
    """The body and its inside, and below them for each contact its pressure and its states."""
    seen = views(body)
    contacts = {contact_view(i): contact for i, contact in enumerate(body.contact.parts())}
    rows = [_TITLE + seen[name].height + _BELOW for name in (BODY, *contacts)]
    sheet = Sheet(2 * WIDTH + 3 * _MARGIN, _HEAD + sum(rows))
    style.head(sheet.figure, body)
    top = _HEAD + _TITLE
    scale = style.scale_words(style.magnification(body))
    sheet.view(seen[BODY], images[BODY], _LEFT, top, f"Deformed body, {scale}")
    inside, title = (LOCKED, style.LOCKED_TITLE) if LOCKED in seen else (CUT, "Cut open")
    sheet.view(seen[inside], images[inside], _RIGHT, top, title)
    top += seen[BODY].height
    shade = style.shade(body)
    sheet.bar(ScalarMappable(shade.norm, shade.cmap), _LEFT, top, _BAR, shade.extend, shade.label)
    if body.locked.any():
        rim = Line2D([], [], color=style.VERMILION, lw=1.6, label=style.RIM_LABEL)
        sheet.legend([rim], _LEFT + _BAR + _MARGIN, top)
    sheet.legend(_handles(body), _RIGHT, top)
    for name, contact in contacts.items():
        top += _BELOW + _TITLE
        _contact(sheet, body, contact, seen[name], images[name], top)
        top += seen[name].height
    return sheet.figure


def frames(
    bodies: Sequence[Snapshot], images: Sequence[Image], look: Look, titles: Sequence[str]
) -> Iterator[Figure]:
    """The pictures of an animation, each with its title and the scale of colours."""
    view, shown = side_view(bodies, look.factor, FILM_WIDTH), np.minimum.reduce(images)
    for image, shade, title in zip(images, look.shades, titles, strict=True):
        sheet = Sheet(view.width + 2 * _MARGIN, _TITLE + view.height + _BELOW)
        sheet.view(view, image, _MARGIN, _TITLE, title, shown)
        colours = ScalarMappable(shade.norm, shade.cmap)
        sheet.bar(colours, _MARGIN, _TITLE + view.height, _BAR, shade.extend, shade.label)
        yield sheet.figure


def _handles(body: Snapshot) -> list[Any]:
    found: list[Any] = [Line2D([], [], color=style.GREY, lw=0.9, label="undeformed")]
    if len(body.contact.points):
        found.append(Patch(facecolor=style.PALE, edgecolor=style.GREY, label="foundation"))
    if body.locked.any():
        found.append(Patch(facecolor=style.VERMILION, label="at the limit"))
    return found


def _contact(
    sheet: Sheet, body: Snapshot, contact: ContactMap, view: View, image: Image, top: float
) -> None:
    points = contact.points
    title = contact.titled(contact_map.PRESSURE_TITLE)
    axes = sheet.view(view, image, _LEFT, top, title)
    handles: list[Any] = []
    shown = contact_map.slipping(points)
    if len(shown):
        x = style.deformed(body, style.magnification(body))[contact.vertices[shown]]
        tails, heads = view.place(x), view.place(x + points.u_tangent[shown])
        contact_map.arrows(axes, tails, heads - tails)
        label = contact_map.slip_label(points, shown)
        handles.append(Line2D([], [], color="white", mec=style.BLACK, marker=">", label=label))
    if (points.state == STICK).any():
        handles.append(Line2D([], [], color=style.BLUE, lw=1.6, label="stick zone"))
    below = top + view.height
    norm = contact_map.pressure_norm(points)
    colours = ScalarMappable(norm, contact_map.PRESSURE_COLOURS)
    sheet.bar(colours, _LEFT, below, _BAR, label=contact_map.PRESSURE_LABEL)
    sheet.legend(handles, _LEFT + _BAR + _MARGIN, below, in_a_row=False)
    place = sheet.place(_RIGHT + _NUMBERS, top, WIDTH - _NUMBERS, view.height - _NUMBERS)
    contact_map.state_map(sheet.figure, place, contact)
    sheet.legend(style.state_patches(), _RIGHT + _NUMBERS, below)
