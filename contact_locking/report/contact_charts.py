"""What happens on Gamma_C: profiles along it in two dimensions, maps of it in three."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial import cKDTree

from contact_locking.plotting import profile, style

from .charts import WIDTH, Chart, chart
from .folder import ContactTable, FloatArray, IntArray

# A step between neighbours that is so much longer than those around it leads to another curve.
_JUMP = 4.0
# The longer side of a map in pixels; how far a point's colour goes, as a share of the distance to
# so many neighbours.
_PIXELS, _REACH, _NEIGHBOURS = 500, 0.75, 3


def contact_charts(contact: ContactTable) -> list[Chart]:
    """The charts for a table of two or three dimensions."""
    if contact.dim == 2:
        description = "Contact pressure, friction traction and its bound along the contact boundary"
        return [
            chart("tractions", description, 3.6, lambda figure: _profile(figure, contact)),
            chart(
                "slip",
                "Tangential displacement and distance to the foundation along the contact boundary",
                2.6,
                lambda figure: _opening(figure, contact),
            ),
        ]
    height = _map_height(contact)
    friction = np.linalg.norm(contact.traction, axis=1)
    return [
        chart(
            "pressure",
            "Map of the contact pressure, seen from the foundation",
            height,
            lambda figure: _map(
                figure, contact, contact.pressure, r"contact pressure $-\sigma_\nu$"
            ),
        ),
        chart(
            "friction",
            "Map of the friction traction, seen from the foundation",
            height,
            lambda figure: _map(figure, contact, friction, r"friction traction $|\sigma_\tau|$"),
        ),
        chart(
            "states",
            "Map of open, sticking and slipping points, seen from the foundation",
            height,
            lambda figure: _state_map(figure, contact),
        ),
    ]


def curves(x: FloatArray) -> list[IntArray]:
    """The points (k, 2), sorted along curves, as the numbers of each curve."""
    steps = np.linalg.norm(np.diff(x, axis=0), axis=1)
    before, after = np.roll(steps, 1), np.roll(steps, -1)
    if len(steps) > 1:
        before[0], after[-1] = steps[1], steps[-2]
    jumps = np.flatnonzero(steps > _JUMP * np.maximum(before, after)) + 1
    return np.split(np.arange(len(x)), jumps if len(steps) > 1 else [])


def _profile(figure: Figure, contact: ContactTable) -> None:
    axes, strip = figure.subplots(2, 1, height_ratios=(1.0, 0.07))
    parts = curves(contact.x)
    positions, label = profile.abscissa([contact.x[part] for part in parts])
    lines = [
        profile.Curve(
            s,
            contact.pressure[part],
            np.sum(contact.traction[part] * _tangents(contact.x[part], s), axis=1),
            contact.bound[part],
            contact.state[part],
        )
        for s, part in zip(positions, parts, strict=True)
    ]
    profile.draw(axes, strip, lines, label)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)


def _opening(figure: Figure, contact: ContactTable) -> None:
    axes = figure.add_subplot()
    parts = curves(contact.x)
    positions, label = profile.abscissa([contact.x[part] for part in parts])
    for number, (s, part) in enumerate(zip(positions, parts, strict=True)):
        slip = np.sum(contact.u_tangent[part] * _tangents(contact.x[part], s), axis=1)
        distance = contact.gap[part] - contact.u_normal[part]
        name = (lambda text: text) if number == 0 else (lambda text: "_" + text)
        axes.plot(s, slip, color=style.VERMILION, lw=1.6, label=name(r"tangential $u_\tau$"))
        axes.plot(s, distance, color=style.BLUE, lw=1.8, label=name(r"distance $g - u_\nu$"))
    axes.axhline(0.0, color=style.GREY, lw=0.7, zorder=0.5)
    axes.margins(x=0.0)
    axes.set_xlabel(label, loc="left")
    axes.set_ylabel("length")
    figure.legend(loc="outside upper left", ncols=2)


def _tangents(x: FloatArray, s: FloatArray) -> FloatArray:
    """Unit tangents (k, 2) of a curve that point to where the abscissa grows."""
    if len(x) < 2:
        return np.array([[1.0, 0.0]] * len(x))
    tangent = np.gradient(x, axis=0)
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    direction = 1.0 if s[-1] >= s[0] else -1.0
    return direction * tangent / np.where(length > 0.0, length, 1.0)


def _frame(contact: ContactTable) -> tuple[int, int, bool]:
    """The two axes of a map, and whether the second has to point down.

    The map shows the side that faces downwards, against the axis in which Gamma_C is thinnest.
    """
    across = int(np.argmin(np.ptp(contact.x, axis=0)))
    i, j = (axis for axis in range(3) if axis != across)
    # x times y points up and y times z along x, away from the viewer, but x times z to the viewer.
    return i, j, across != 1


def _map_height(contact: ContactTable) -> float:
    i, j, _ = _frame(contact)
    width, height = np.ptp(contact.x[:, [i, j]], axis=0)
    return float(np.clip(0.85 * WIDTH * height / (width or 1.0), 2.0, 6.0)) + 0.9


def _map(figure: Figure, contact: ContactTable, values: FloatArray, label: str) -> None:
    axes = figure.add_subplot(aspect="equal")
    drawn = _colour_by_nearest(axes, contact, values, cmap="cividis", vmin=0.0)
    figure.colorbar(drawn, ax=axes, orientation="horizontal", label=label, aspect=40, pad=0.02)


def _state_map(figure: Figure, contact: ContactTable) -> None:
    axes = figure.add_subplot(aspect="equal")
    _colour_by_nearest(axes, contact, contact.state, cmap=style.STATES, vmin=-0.5, vmax=2.5)
    figure.legend(handles=style.state_patches(), loc="outside lower center", ncols=3)


def _colour_by_nearest(
    axes: Axes, contact: ContactTable, values: FloatArray | IntArray, **colours: Any
) -> Any:
    """Give each pixel the value of the nearest point, if that is as near as points are here."""
    i, j, downwards = _frame(contact)
    axes.set_xlabel(f"${'xyz'[i]}$")
    axes.set_ylabel(f"${'xyz'[j]}$")
    flat = contact.x[:, [i, j]]
    tree = cKDTree(flat)
    neighbours = min(_NEIGHBOURS + 1, len(flat))
    reach = _REACH * tree.query(flat, k=[neighbours])[0][:, 0]
    low, high = flat.min(axis=0) - reach.max(), flat.max(axis=0) + reach.max()
    step = float((high - low).max()) / _PIXELS or 1.0
    grid = [np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True)]
    distance, nearest = tree.query(np.stack(np.meshgrid(*grid), axis=-1))
    image = np.ma.masked_where(distance > reach[nearest], values[nearest])
    drawn = axes.imshow(image, extent=(low[0], high[0], low[1], high[1]), origin="lower", **colours)
    axes.yaxis.set_inverted(downwards)
    return drawn
