"""``python3 -m contact_locking.view.pictures.render SOURCE TARGET SECONDS``: drawn by PyVista.

SOURCE is the file of a snapshot of a body in 3D.  This module is a program of its own,
as VTK ends its process if it finds no screen or no OpenGL.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pyvista as pv
from matplotlib.colors import ListedColormap

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.results.contact_points import OPEN, STATE_NAMES, STICK
from contact_locking.view.pictures import style
from contact_locking.view.pictures.contact_map import (
    PRESSURE_COLOURS,
    nearest_parts,
    pressure_norm,
    slipping,
)
from contact_locking.view.pictures.offscreen import Image
from contact_locking.view.pictures.snapshot import Snapshot, foundation, load, tool
from contact_locking.view.pictures.views import Camera, contact_camera, cut, side_camera

# Faces that meet at a larger angle, in degrees, make an edge of the body.
_SHARP = 30.0
# Light shows the shape; a surface in the colours of values keeps most of its colour.
_MATT = {"ambient": 0.75, "diffuse": 0.33, "specular": 0.0}
_PLAIN = {"ambient": 0.62, "diffuse": 0.48, "specular": 0.0}
_GLASS, _PALE_BODY = 0.16, "#cfcfcf"
# The open part of Gamma_C is nearly white, as the background is white.
_APART = "#fcfcfc"

# Line widths in points.
_EDGE, _FINE, _CASING, _RIM, _BAND = 1.0, 0.7, 3.0, 1.6, 7.0
_SHADES = 512
# The longest arrow of the slip as a share of the body.
_ARROW = 0.1


class Scene:
    """Draws a snapshot, deformed by ``factor``, into a plotter with ``point`` pixels to a point.

    Lines move by ``lift`` (3,) towards the viewer: a wide line faces the viewer, and a surface that
    does not would hide half of a line that lies in the surface.
    """

    def __init__(
        self, plotter: Any, body: Snapshot, factor: float, point: float, lift: FloatArray
    ) -> None:
        self._plotter, self._body, self._factor, self._point = plotter, body, factor, point
        self._lift = lift
        self._x = style.deformed(body, factor)
        self._faces = _outward(body)
        self._share = style.locked_share(body)

    def deformed_body(self, **bar: Any) -> None:
        """The surface in the colours of the strain, the rim of the locked zone, the foundation."""
        skin = _surface(self._x, self._faces)
        self._strain(skin, self._body.boundary_cell, **bar)
        self._edges(self._body.x, style.GREY, _FINE)
        self._edges(self._x, style.BLACK, _EDGE)
        self._foundation()

    def cut_open(self, **bar: Any) -> None:
        """The deformed body without the half that is nearer to the viewer."""
        towards, middle = cut(self._body, self._x)
        half = self._grid().clip(normal=towards, origin=middle, invert=True)
        if half.n_cells:
            skin = half.extract_surface()
            self._strain(skin, skin.cell_data["cell"], **bar)
            rims = skin.extract_feature_edges(_SHARP, manifold_edges=False)
            self._line(rims, style.BLACK, _EDGE)
        self._edges(self._x, style.BLACK, _FINE)
        self._foundation(towards, middle)

    def locked_zone(self) -> None:
        """The locked cells, which the number of the summary counts, inside a body of glass."""
        self._body_but_contact(color=style.GREY, opacity=_GLASS, **_PLAIN)
        if self._body.locked.any():
            cells = self._grid().extract_cells(self._body.locked)
            self._add(cells.extract_surface(), color=style.VERMILION, **_PLAIN)
        self._edges(self._x, style.BLACK, _EDGE)
        self._foundation()

    def pressure(self, **bar: Any) -> None:
        """The touching part of Gamma_C in the colours of the pressure, on a pale body."""
        self._pale_body()
        contact = self._body.contact
        norm, colours = pressure_norm(contact.points), matplotlib.colormaps[PRESSURE_COLOURS]
        most = float(norm.vmax or 1.0)
        scale = ListedColormap(colours(norm(np.linspace(0.0, most, _SHADES))))
        part = _surface(self._lifted_contact(), contact.facets)
        part.point_data["pressure"] = contact.points.pressure
        part.point_data["touches"] = (contact.points.state != OPEN).astype(float)
        half = {"scalars": "touches", "value": 0.5}
        apart, touching = (part.clip_scalar(invert=invert, **half) for invert in (True, False))
        if apart.n_points:
            self._add(apart, color=_APART, lighting=False)
        if touching.n_points:
            how = {"cmap": scale, "n_colors": _SHADES, "clim": (0.0, most), "lighting": False}
            self._add(touching, scalars="pressure", **how, **bar)
        self._line(part.contour([0.5], scalars="touches"), style.BLACK, _FINE)
        part.point_data["sticks"] = (contact.points.state == STICK).astype(float)
        self._cased_line(part.contour([0.5], scalars="sticks"), style.BLUE)

    def states(self, **bar: Any) -> None:
        """Gamma_C in the colours of open, stick and slip, on a pale body."""
        self._pale_body()
        contact = self._body.contact
        parts, point = nearest_parts(self._lifted_contact(), contact.facets)
        part = _loose(parts)
        part.cell_data["state"] = contact.points.state[point]
        names = dict(enumerate(STATE_NAMES))
        how = {"cmap": style.STATES, "n_colors": len(names), "clim": (-0.5, len(names) - 0.5)}
        self._add(part, scalars="state", annotations=names, lighting=False, **how, **bar)
        shown = slipping(contact.points)
        slip = contact.points.u_tangent[shown]
        longest = float(np.linalg.norm(slip, axis=1).max(initial=0.0))
        if longest > 0.0:
            arrows = pv.PolyData(self._lifted_contact()[shown] + self._lift)
            arrows.point_data["slip"] = slip
            size = _ARROW * self._body.size / longest
            glyphs = arrows.glyph(orient="slip", scale="slip", factor=size)
            self._add(glyphs, color=style.BLACK, lighting=False)

    def _lifted_contact(self) -> FloatArray:
        """Points of Gamma_C in front of the body, whose hexahedra have other triangles there."""
        return self._x[self._body.contact.vertices] + self._lift

    def _strain(self, skin: Any, cell: IntArray, **bar: Any) -> None:
        """Add a surface in the colours of the strain; ``cell`` has the cell of each face."""
        shade = style.shade(self._body)
        skin.cell_data["shade"] = shade.values[cell].filled(np.nan)
        colours = {"cmap": shade.cmap, "clim": (0.0, shade.norm.vmax), "nan_color": style.PALE}
        self._add(skin, scalars="shade", **colours, **bar, **_MATT)
        if self._body.locked.any():
            if "share" not in skin.point_data:
                skin.point_data["share"] = self._share
            rim = skin.contour([style.RIM_SHARE], scalars="share")
            self._cased_line(rim, style.VERMILION)

    def _grid(self) -> Any:
        """The cells with their numbers, and the locked share of the cells around each vertex."""
        grid = pv.UnstructuredGrid({pv.CellType.TETRA: self._body.cells}, self._x)
        grid.cell_data["cell"] = np.arange(len(self._body.cells))
        grid.point_data["share"] = self._share
        return grid

    def _body_but_contact(self, **how: Any) -> None:
        """Add the surface of the body without Gamma_C, whose place another surface takes."""
        contact = self._body.contact
        both = np.sort(np.vstack([contact.vertices[contact.facets], self._faces]), axis=1)
        _, number = np.unique(both, axis=0, return_inverse=True)
        number, first = number.reshape(-1), len(contact.facets)
        faces = self._faces[~np.isin(number[first:], number[:first])]
        if len(faces):
            self._add(_surface(self._x, faces), **how)

    def _pale_body(self) -> None:
        # A body that is touched by another one lies between the viewer and the interface.
        opacity = _GLASS if any(self._body.contact.bodies) else 1.0
        self._body_but_contact(color=_PALE_BODY, opacity=opacity, **_PLAIN)
        self._edges(self._x, style.BLACK, _FINE)

    def _foundation(self, towards: FloatArray | None = None, middle: Any = None) -> None:
        """Add the foundations, without the half beyond a plane if one is given."""
        for contact in self._body.contact.on_foundations():
            corners = foundation(contact, self._factor, self._body.size)
            ground, plane = _loose(corners), len(corners) == 1
            how: dict[str, Any] = {"lighting": False} if plane else _PLAIN
            if len(tool(contact, self._factor)):
                how = how | {"opacity": style.TOOL_OPACITY}
                if towards is not None:
                    ground = ground.clip(normal=towards, origin=middle, invert=True)
                    if not ground.n_points:
                        continue
            self._add(ground, color=style.PALE, **how)
            if plane:
                self._line(ground.extract_feature_edges(), style.GREY, _FINE)

    def _edges(self, x: FloatArray, colour: str, width: float) -> None:
        skin = _surface(x, self._faces)
        self._line(skin.extract_feature_edges(_SHARP, manifold_edges=False), colour, width)

    def _line(self, mesh: Any, colour: str, width: float, layer: int = 0) -> None:
        """Add lines that lie in a surface, in front of the surface and of lines of lower layers."""
        if mesh.n_points:
            mesh = mesh.translate((1 + layer) * self._lift)
            width *= self._point
            actor = self._add(mesh, color=colour, line_width=width, lighting=False)
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -4.0 * layer)

    def _cased_line(self, mesh: Any, colour: str) -> None:
        """Add lines with a white border, which are visible on any colour."""
        self._line(mesh, "white", _CASING, 1)
        self._line(mesh, colour, _RIM, 2)

    def _add(self, mesh: Any, **how: Any) -> Any:
        how = {"show_scalar_bar": "scalar_bar_args" in how, "line_width": _BAND * self._point} | how
        actor = self._plotter.add_mesh(mesh, reset_camera=False, render=False, **how)
        actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
        return actor


def _outward(body: Snapshot) -> IntArray:
    """The faces (b, 3) of the boundary, each turned so that its normal points outwards."""
    corners = body.x[body.boundary]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside = body.x[body.cells[body.boundary_cell]].mean(axis=1)
    inwards = np.sum(normals * (corners[:, 0] - inside), axis=1) < 0.0
    return np.where(inwards[:, None], body.boundary[:, ::-1], body.boundary)


def _surface(points: FloatArray, facets: IntArray) -> Any:
    return pv.PolyData.from_regular_faces(points, facets)


def _loose(shapes: FloatArray) -> Any:
    """Shapes (m, k, 3) that share no points."""
    return _surface(shapes.reshape(-1, 3), np.arange(shapes[..., 0].size).reshape(len(shapes), -1))


@dataclass(frozen=True)
class View:
    """A way to draw a body, its title, and the camera."""

    title: str
    draw: Callable[[Scene], None]
    camera: Camera


# Places and sizes are shares of the picture.
_BAR = {"title": "", "vertical": True, "n_labels": 6, "fmt": "%.3g"}
_BAR |= {"width": 0.05, "height": 0.5, "position_x": 0.88, "position_y": 0.2}


def views(body: Snapshot, factor: float) -> list[View]:
    """The body, cut open, its locked zone, and each contact."""
    side = side_camera(body, factor)
    limited = np.isfinite(body.locking_limit).any()
    strain = "|ε(u)| / M" if limited else "|ε(u)|"
    look = _BAR | {"label_font_size": _LETTERS, "unconstrained_font_size": True}
    bar, names = {"scalar_bar_args": look}, {"scalar_bar_args": look | {"n_labels": 0}}
    found = [View(f"Deformed body, {strain}", lambda scene: scene.deformed_body(**bar), side)]
    found.append(View(f"Cut open, {strain}", lambda scene: scene.cut_open(**bar), side))
    if body.locked.any():
        found.append(View("Cells at the strain limit, |ε(u)| ≥ M", Scene.locked_zone, side))
    for part in body.contact.parts():
        name, towards = part.names[0] and f": {part.names[0]}", contact_camera(body, part, factor)
        found += [
            View(f"Contact pressure{name}", lambda scene: scene.pressure(**bar), towards),
            View(f"Open, stick and slip{name}", lambda scene: scene.states(**names), towards),
        ]
    return found


# Pictures are drawn larger by this factor and then reduced, which makes edges smooth.
_FINER = 2
#: Width and height of a view in pixels.
SIZE = (800, 600)
# Pixels to a point, and the size of letters.
_POINT, _LETTERS = 2.0, 34
# Lines move towards the viewer by this share of the body's size.
_LIFT = 0.005


def render(body: Snapshot) -> dict[str, Image]:
    """The views (h, w, 3) of a body by their titles."""
    # One plotter for all pictures: an X server without clients may end.
    plotter, factor = _plotter(), style.magnification(body)
    drawn = {view.title: _image(plotter, body, factor, view) for view in views(body, factor)}
    plotter.close()
    return drawn


def _plotter() -> Any:
    size = [_FINER * length for length in SIZE]
    plotter: Any = pv.Plotter(off_screen=True, lighting="none", window_size=size)
    plotter.set_background("white")
    plotter.add_light(pv.Light(position=(-0.5, 0.9, 1.4), light_type="camera light"))
    # Depth peeling, which glass takes, does not work with several samples for each pixel.
    plotter.render_window.SetMultiSamples(0)
    plotter.enable_depth_peeling()
    return plotter


def _image(plotter: Any, body: Snapshot, factor: float, view: View) -> Image:
    for name in list(plotter.scalar_bars.keys()):
        plotter.remove_scalar_bar(name, render=False)
    plotter.clear_actors()
    lift = _LIFT * body.size * view.camera.towards
    view.draw(Scene(plotter, body, factor, _FINER * _POINT, lift))
    _look(plotter, view.camera)
    # The arrows along the axes of an earlier picture would be turned one picture late.
    plotter.add_axes(viewport=(0.0, 0.0, 0.25, 0.25))
    plotter.render()
    return _coarser(np.asarray(plotter.screenshot(return_img=True))[..., :3])


# Half the height of a picture over that of the body, and the room on the right for a scale of
# colours over the width of the body.
_ROOM, _BESIDE = 0.65, 0.08


def _look(plotter: Any, camera: Camera) -> None:
    """Set the camera of a plotter."""
    across, down = plotter.window_size
    distance = 10.0 * max(camera.width, camera.height)
    centre = camera.centre + _BESIDE * camera.width * camera.right
    plotter.camera.position = centre + distance * camera.towards
    plotter.camera.focal_point = centre
    plotter.camera.up = camera.up
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = _ROOM * max(camera.height, camera.width * down / across)
    plotter.reset_camera_clipping_range()


def _coarser(image: Image) -> Image:
    steps = range(_FINER)
    total = sum(image[i::_FINER, j::_FINER].astype(np.uint16) for i in steps for j in steps)
    return np.asarray(total // _FINER**2, dtype=np.uint8)


def main(source: Path, target: Path, seconds: int) -> None:
    """Render the views of a snapshot into a file of NumPy."""
    # If a graphics driver hangs, the process that has started this one may be gone.
    signal.alarm(seconds)
    images: dict[str, Any] = dict(render(load(source)))
    with target.open("wb") as stream:
        np.savez(stream, **images)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
