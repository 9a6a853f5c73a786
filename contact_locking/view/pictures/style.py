"""What a picture shows, as arrays of NumPy, and its colours, scales, titles and legends.

Colour-blind readers can tell the colours apart.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, ListedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.results.contact_points import STATE_NAMES, ContactPoints
from contact_locking.results.in_words import value_in_words
from contact_locking.results.quantities import QUANTITIES


@dataclass(frozen=True)
class ContactMap:
    """Gamma_C, which has no points in a body without contact.

    ``facets`` (m, d) are numbers of the points, ``vertices`` (k,) the points as vertices of the
    body, ``smoothed`` (k,) is R sigma_nu, and ``names`` are those of the contacts.  ``tools`` has
    for each contact the facets (t, d, d) of the surface of the tool at its place, by their corners,
    and none for a foundation that is drawn as far as Gamma_C sees it.  ``bodies`` tells which
    contacts are with another body, which is no foundation.
    """

    points: ContactPoints
    facets: IntArray
    vertices: IntArray
    smoothed: FloatArray
    names: tuple[str, ...]
    tools: tuple[FloatArray, ...]
    bodies: tuple[bool, ...]

    def parts(self) -> list[ContactMap]:
        """The map of each contact, which has a name if there are several."""
        return [
            ContactMap(
                self.points[rows],
                facets_within(self.facets, rows),
                self.vertices[rows],
                self.smoothed[rows],
                (self.names[number] if len(self.names) > 1 else "",),
                (self.tools[number],),
                (self.bodies[number],),
            )
            for number, rows in enumerate(self.points.rows())
        ]

    def on_foundations(self) -> list[ContactMap]:
        """The maps of the contacts with foundations."""
        return [contact for contact in self.parts() if not any(contact.bodies)]


@dataclass(frozen=True)
class Snapshot:
    """The body with v vertices, c cells and b boundary facets, numbered over all ranks.

    ``x`` and ``displacement`` are (v, d), ``cells`` (c, d + 1), ``boundary`` (b, d) and
    ``boundary_cell`` (b,); strain norm, locking limit and ``locked`` are (c,).
    """

    x: FloatArray
    displacement: FloatArray
    cells: IntArray
    boundary: IntArray
    boundary_cell: IntArray
    strain_norm: FloatArray
    locking_limit: FloatArray
    locked: npt.NDArray[np.bool_]
    contact: ContactMap
    title: str
    dofs: int
    locked_fraction: float
    converged: bool

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])

    @property
    def size(self) -> float:
        """The longest edge of the body's bounding box."""
        return float(np.ptp(self.x, axis=0).max())


def save(body: Snapshot, path: Path) -> None:
    """Write a snapshot for another process, as a file of NumPy."""
    contact = body.contact
    owners = {"body": vars(body), "contact": vars(contact), "points": vars(contact.points)}
    arrays: dict[str, Any] = {
        f"{owner}.{name}": np.asarray(value)
        for owner, values in owners.items()
        for name, value in values.items()
        if name != "tools" and not isinstance(value, ContactMap | ContactPoints)
    }
    arrays |= {f"tools.{number:06}": facets for number, facets in enumerate(contact.tools)}
    with path.open("wb") as stream:
        np.savez(stream, **arrays)


def load(path: Path) -> Snapshot:
    """Read what :func:`save` has written."""
    owners: dict[str, dict[str, Any]] = {"body": {}, "contact": {}, "points": {}, "tools": {}}
    with np.load(path) as file:
        for key, value in file.items():
            owner, _, name = key.partition(".")
            owners[owner][name] = value if value.ndim else value.item()
    of_contact = owners["contact"]
    for name in ("names", "bodies"):
        of_contact[name] = tuple(of_contact[name].tolist())
    points, tools = ContactPoints(**owners["points"]), tuple(owners["tools"].values())
    return Snapshot(**owners["body"], contact=ContactMap(points, tools=tools, **of_contact))


def nearest_parts(x: FloatArray, facets: IntArray) -> tuple[FloatArray, IntArray]:
    """Divide facets (m, 3) of points x (k, e) into a part for each corner: shapes, and corners.

    The shapes are quadrilaterals (3 m, 4, e).
    """
    corners = x[facets]
    centre = corners.mean(axis=1)
    shapes = []
    for k in range(3):
        before, after = (0.5 * (corners[:, k] + corners[:, (k + s) % 3]) for s in (1, 2))
        shapes.append(np.stack([corners[:, k], before, centre, after], axis=1))
    return np.concatenate(shapes), facets.T.ravel()


# Reach of the drawn foundation beyond Gamma_C as a share of the body's size.
_REACH = 0.12
# A tool that reaches farther beyond the body, as a share of its size, and one of more facets, is
# drawn as far as Gamma_C sees it.
_FARTHEST, _MOST_FACETS = 1.5, 20_000
# Points are in a plane if their distance from the plane is below this share of their extent.
_PLANE = 1e-6


def touched(contact: ContactMap, factor: float) -> FloatArray:
    """The points (k, d) of the foundation below those of Gamma_C, at ``factor`` times the gap."""
    points = contact.points
    return points.x + factor * points.gap[:, None] * points.normal


def drawn_tool(outline: FloatArray, x: FloatArray) -> FloatArray:
    """The facets (t, d, d) of a tool if all of it is drawn beside the body x (v, d), else none."""
    low, high = x.min(axis=0), x.max(axis=0)
    reach = _FARTHEST * float((high - low).max())
    beside = np.all(outline >= low - reach) and np.all(outline <= high + reach)
    return outline if beside and len(outline) <= _MOST_FACETS else outline[:0]


def tool(contact: ContactMap, factor: float) -> FloatArray:
    """The facets (t, d, d) of the tool of one contact, if the picture has a true scale."""
    (facets,) = contact.tools
    return facets if factor == 1.0 else facets[:0]


def foundation(contact: ContactMap, factor: float, size: float) -> FloatArray:
    """The facets of a tool, or the surface at Gamma_C + gap nu (m, 3 or 4, 3).

    The surface is one rectangle if it is plane, else it has the facets of Gamma_C.
    """
    if len(facets := tool(contact, factor)):
        return facets
    surface = touched(contact, factor)
    centre = surface.mean(axis=0)
    _, spread, basis = np.linalg.svd(surface - centre, full_matrices=False)
    if spread[2] > _PLANE * spread[0]:
        return surface[contact.facets]
    # Along the axes of coordinates where the plane allows it.
    first = np.eye(3)[np.argmin(np.abs(basis[2]))]
    first = first - (first @ basis[2]) * basis[2]
    first /= np.linalg.norm(first)
    frame = np.array([first, np.cross(basis[2], first)])
    flat = (surface - centre) @ frame.T
    low, high = flat.min(axis=0) - _REACH * size, flat.max(axis=0) + _REACH * size
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return (centre + corners @ frame)[None]


def facets_within(facets: IntArray, rows: slice) -> IntArray:
    """The facets (m, d) of the contact with these rows, as numbers of the points of the contact."""
    inside = (facets[:, 0] >= rows.start) & (facets[:, 0] < rows.stop)
    return facets[inside] - rows.start


# Okabe and Ito's palette.
BLUE, SKY, ORANGE, VERMILION, BLACK = "#0072B2", "#56B4E9", "#E69F00", "#D55E00", "#1a1a1a"
GREY, PALE = "#7a7a7a", "#e4e4e4"
STATE_COLOURS = (PALE, BLUE, VERMILION)
STATES = ListedColormap(STATE_COLOURS)
#: The labels of units, by the names of the units.
Units = Mapping[str, str]

RC: dict[str, Any] = {
    "font.family": "sans-serif",
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titley": 1.0,  # otherwise Matplotlib measures every label to place a title
    "axes.labelsize": 9.5,
    "axes.edgecolor": "#444444",
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.labelsize": 8.5,
    "ytick.labelsize": 8.5,
    "hatch.linewidth": 0.6,
    "hatch.color": BLACK,
    "mathtext.fontset": "dejavusans",
}
DPI = 160
#: The height of the title and the numbers of a picture in inches.
HEAD = 0.75

# On the line around the locked zone this share of the cells around a vertex is locked: linear
# elements leave many cells of a zone a little below the limit.
RIM_SHARE = 0.25

# The size of a title in points; the numbers of characters above which a title is smaller, and
# above which it is shortened.
_TITLE_SIZE, _FULL_SIZE_TITLE, _LONGEST_TITLE = 13.0, 56, 120

# The share of the cells whose values are within the scale of colours.
_QUANTILE = 0.99
# Displacements smaller than the first share of the body are magnified to about the second.
_VISIBLE, _SHOWN = 0.03, 0.08


@dataclass(frozen=True)
class Shade:
    """The values (c,) that colour the cells, a masked array, with their scale and label."""

    values: Any
    label: str
    norm: Normalize
    cmap: Colormap
    extend: str


def shade(body: Snapshot) -> Shade:
    """|eps|/M, or |eps| for a body that never locks."""
    limited = np.isfinite(body.locking_limit)
    locks = bool(limited.any())
    if locks:
        values = np.ma.masked_where(~limited, body.strain_norm / body.locking_limit)
        label = r"$|\varepsilon(u)|\,/\,M$"
        label += "" if limited.all() else r"   (grey: $M = \infty$)"
    else:
        values, label = np.ma.asarray(body.strain_norm), r"$|\varepsilon(u)|$"
    present = values.compressed()
    # Few cells exceed the largest colour, as a peak would use up the colours.
    top = float(np.quantile(present, _QUANTILE))
    if locks and 0.5 < top < 1.1:
        top = 1.0
    top = top or float(present.max()) or 1.0
    extend = "max" if present.max() > 1.001 * top else "neither"
    cmap = matplotlib.colormaps["viridis"].with_extremes(bad=PALE)
    return Shade(values, label, Normalize(0.0, top), cmap, extend)


def locked_share(body: Snapshot) -> FloatArray:
    """The share (v,) of the cells around a vertex that are locked."""
    number = np.bincount(body.cells.ravel())
    locked = np.bincount(body.cells[body.locked].ravel(), minlength=len(number))
    return locked / number


def magnification(body: Snapshot) -> float:
    """The factor of the drawn displacement: 1, or a round number if the displacement is small.

    If the gap varies along a contact, the factor is 1, as another would deform the foundation.
    """
    largest = float(np.linalg.norm(body.displacement, axis=1).max(initial=0.0))
    share = largest / body.size
    curved = any(np.ptp(contact.points.gap) > 1e-9 * body.size for contact in body.contact.parts())
    if curved or not 0.0 < share < _VISIBLE:
        return 1.0
    aim = _SHOWN / share
    power = 10.0 ** np.floor(np.log10(aim))
    return power * max(step for step in (1, 2, 5) if step * power <= aim)


def scale_words(factor: float) -> str:
    """The scale of the displacement, for a title."""
    return "true scale" if factor == 1.0 else f"displacement \u00d7 {factor:g}"


def panel(figure: Figure, left: float, top: float, width: float, height: float) -> Axes:
    """New axes of a size, at distances from the left and the top of the figure, in inches.

    An automatic layout measures all words before they are drawn, which takes as long as to draw.
    """
    across, down = figure.get_size_inches()
    where = (left / across, 1.0 - (top + height) / down, width / across, height / down)
    return figure.add_axes(where)


def labelled(text: str, unit: str, units: Units) -> str:
    """The text with the unit in brackets, as far as there is a label for it."""
    return f"{text} [{units[unit]}]" if unit in units else text


def power_beside(axes: Axes) -> None:
    """The power of ten of the vertical scale stands left of the axis, clear of a title above it."""
    axes.yaxis.get_offset_text().set(x=-0.01, horizontalalignment="right")


def head(figure: Figure, body: Snapshot) -> None:
    """Write the study's title and a line of numbers into the upper `HEAD` inches of the figure."""
    numbers = f"{body.dofs:,} dofs".replace(",", "\u2009")
    if body.locked.any():
        numbers += f"     {value_in_words(QUANTITIES['locked_fraction'], body.locked_fraction)}"
    if not body.converged:
        numbers += "     NOT CONVERGED"
    height = figure.get_figheight()
    # In a title, which users write, a dollar sign begins no formula.
    title = textwrap.shorten(body.title or "Locking body in contact", _LONGEST_TITLE)
    size = _TITLE_SIZE * min(1.0, _FULL_SIZE_TITLE / len(title))
    centred: dict[str, Any] = {"ha": "center", "va": "center", "parse_math": False}
    figure.text(0.5, 1.0 - 0.27 / height, title, fontsize=size, fontweight="bold", **centred)
    colour = GREY if body.converged else VERMILION
    figure.text(0.5, 1.0 - 0.55 / height, numbers, fontsize=9, color=colour, **centred)


def state_patches() -> list[Patch]:
    """The legend of open, stick and slip."""
    return [
        Patch(facecolor=colour, edgecolor=GREY, linewidth=0.5, label=name)
        for colour, name in zip(STATE_COLOURS, STATE_NAMES, strict=True)
    ]


def deformed(body: Snapshot, factor: float) -> FloatArray:
    """Vertices (v, d) moved by ``factor`` times their displacement."""
    return body.x + factor * body.displacement


def view_frame(towards: FloatArray) -> FloatArray:
    """The unit vectors (3, 3) to the right, up and ``towards`` a viewer for whom z is upwards."""
    towards = towards / np.linalg.norm(towards)
    right = np.cross(np.eye(3)[2 if abs(towards[2]) < 0.999 else 1], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])
