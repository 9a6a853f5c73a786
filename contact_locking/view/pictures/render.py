"""``python3 -m contact_locking.view.pictures.render SOURCE TARGET SECONDS``: drawn by PyVista.

SOURCE is the file of a snapshot of a body in 3D.  This module is a program of its own,
as VTK ends its process if it finds no screen or no OpenGL.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import numpy as np
import pyvista as pv
from matplotlib.colors import ListedColormap, PowerNorm

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.results.contact_points import OPEN, STATE_NAMES, STICK
from contact_locking.view.pictures import style
from contact_locking.view.pictures.space import Image
from contact_locking.view.pictures.style import (
    ContactMap,
    Snapshot,
    foundation,
    load,
    nearest_parts,
    tool,
)

# Faces that meet at a larger angle, in degrees, make an edge of the body.
_SHARP = 30.0
# Light shows the shape; a surface in the colours of values keeps most of its colour.
_MATT = {"ambient": 0.75, "diffuse": 0.33, "specular": 0.0}
_PLAIN = {"ambient": 0.62, "diffuse": 0.48, "specular": 0.0}
_GLASS, _PALE_BODY = 0.16, "#cfcfcf"
# The open part of Gamma_C is nearly white, as the background is white.
_APART = "#fcfcfc"
# A tool shows the part of the body behind it.
_TOOL_OPACITY = 0.45

# Line widths in points.
_EDGE, _FINE, _CASING, _RIM, _BAND = 1.0, 0.7, 3.0, 1.6, 7.0
_SHADES = 512
# At a larger ratio of the largest to the median pressure the colours follow the square root.
_PEAKED = 6.0

# Pictures are drawn larger by this factor and then reduced, which makes edges smooth.
_FINER = 2
#: Width and height of a view in pixels.
SIZE = (800, 600)
# Pixels to a point, and the size of letters.
_POINT, _LETTERS = 2.0 * _FINER, 34
# Lines move towards the viewer by this share of the body's size.
_LIFT = 0.005
# Half the height of a picture over that of the body, and the room on the right for a scale of
# colours over the width of the body.
_ROOM, _BESIDE = 0.65, 0.08
# Places and sizes are shares of the picture.
_BAR = {"title": "", "vertical": True, "n_labels": 6, "fmt": "%.3g"}
_BAR |= {"width": 0.05, "height": 0.5, "position_x": 0.88, "position_y": 0.2}
_BAR |= {"label_font_size": _LETTERS, "unconstrained_font_size": True}


class Scene:
    """Draws a snapshot, deformed by ``factor``, into a plotter.

    Lines move a little towards the viewer: a wide line faces the viewer, and a surface that does
    not would hide half of a line that lies in the surface.
    """

    def __init__(self, plotter: Any, body: Snapshot, factor: float, towards: FloatArray) -> None:
        self._plotter, self._body, self._factor = plotter, body, factor
        self._lift = _LIFT * body.size * towards
        self._x = style.deformed(body, factor)
        self._faces = _outward(body)
        self._share = style.locked_share(body)

    def deformed_body(self) -> None:
        """The surface in the colours of the strain, the rim of the locked zone, the foundation."""
        skin = _surface(self._x, self._faces)
        self._strain(skin, self._body.boundary_cell)
        self._edges(self._body.x, style.GREY, _FINE)
        self._edges(self._x, style.BLACK, _EDGE)
        self._foundation()

    def cut_open(self) -> None:
        """The deformed body without the half that is nearer to the viewer.

        The cut goes through the middle of the pressure, or of a body without pressure.
        """
        contact = self._body.contact
        towards = across(mean_normal(contact))
        middle = 0.5 * (self._x.min(axis=0) + self._x.max(axis=0))
        if contact.points.pressure.any():
            weights = contact.points.pressure
            middle = np.average(self._x[contact.vertices], axis=0, weights=weights)
        half = self._grid().clip(normal=towards, origin=middle, invert=True)
        if half.n_cells:
            skin = half.extract_surface()
            self._strain(skin, skin.cell_data["cell"])
            rims = skin.extract_feature_edges(_SHARP, manifold_edges=False)
            self._line(rims, style.BLACK, _EDGE)
        self._edges(self._x, style.BLACK, _FINE)
        self._foundation(towards, middle)

    def locked_zone(self) -> None:
        """The locked cells, which the number of the summary counts, inside a body of glass."""
        self._body_but_contact(color=style.GREY, opacity=_GLASS, **_PLAIN)
        cells = self._grid().extract_cells(self._body.locked)
        self._add(cells.extract_surface(), color=style.VERMILION, **_PLAIN)
        self._edges(self._x, style.BLACK, _EDGE)
        self._foundation()

    def pressure(self) -> None:
        """The touching part of Gamma_C in the colours of the pressure, on a pale body."""
        self._pale_body()
        contact = self._body.contact
        # On a linear scale a peak at a corner would leave all other points dark.
        pressures = contact.points.pressure[contact.points.pressure > 0.0]
        most = float(pressures.max(initial=0.0)) or 1.0
        peaked = len(pressures) > 0 and most > _PEAKED * np.median(pressures)
        norm = PowerNorm(0.5 if peaked else 1.0, vmin=0.0, vmax=most)
        colours = matplotlib.colormaps["cividis"](norm(np.linspace(0.0, most, _SHADES)))
        surface = _surface(self._lifted_contact(), contact.facets)
        surface.point_data["pressure"] = contact.points.pressure
        surface.point_data["touches"] = (contact.points.state != OPEN).astype(float)
        half = {"scalars": "touches", "value": 0.5}
        apart, touching = (surface.clip_scalar(invert=invert, **half) for invert in (True, False))
        if apart.n_points:
            self._add(apart, color=_APART, lighting=False)
        if touching.n_points:
            how = {"cmap": ListedColormap(colours), "n_colors": _SHADES, "clim": (0.0, most)}
            how |= {"scalars": "pressure", "scalar_bar_args": _BAR, "lighting": False}
            self._add(touching, **how)
        self._line(surface.contour([0.5], scalars="touches"), style.BLACK, _FINE)
        surface.point_data["sticks"] = (contact.points.state == STICK).astype(float)
        self._cased_line(surface.contour([0.5], scalars="sticks"), style.BLUE)

    def states(self) -> None:
        """Gamma_C in the colours of open, stick and slip, on a pale body."""
        self._pale_body()
        contact = self._body.contact
        parts, point = nearest_parts(self._lifted_contact(), contact.facets)
        points = _loose(parts)
        points.cell_data["state"] = contact.points.state[point]
        how = {"cmap": style.STATES, "n_colors": 3, "clim": (-0.5, 2.5), "lighting": False}
        how |= {"scalars": "state", "annotations": dict(enumerate(STATE_NAMES))}
        self._add(points, scalar_bar_args=_BAR | {"n_labels": 0}, **how)

    def _lifted_contact(self) -> FloatArray:
        """Points of Gamma_C in front of the body, whose hexahedra have other triangles there."""
        return self._x[self._body.contact.vertices] + self._lift

    def _strain(self, skin: Any, cell: IntArray) -> None:
        """Add a surface in the colours of the strain; ``cell`` has the cell of each face."""
        shade = style.shade(self._body)
        skin.cell_data["shade"] = shade.values[cell].filled(np.nan)
        colours = {"cmap": shade.cmap, "clim": (0.0, shade.norm.vmax), "nan_color": style.PALE}
        self._add(skin, scalars="shade", **colours, scalar_bar_args=_BAR, **_MATT)
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
        touching = {frozenset(facet) for facet in contact.vertices[contact.facets]}
        others = [face for face in self._faces if frozenset(face) not in touching]
        if others:
            self._add(_surface(self._x, np.array(others)), **how)

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
            how: dict[str, Any] = {"lighting": False} if plane else dict(_PLAIN)
            if len(tool(contact, self._factor)):
                how["opacity"] = _TOOL_OPACITY
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
            actor = self._add(mesh, color=colour, line_width=_POINT * width, lighting=False)
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, -4.0 * layer)

    def _cased_line(self, mesh: Any, colour: str) -> None:
        """Add lines with a white border, which are visible on any colour."""
        self._line(mesh, "white", _CASING, 1)
        self._line(mesh, colour, _RIM, 2)

    def _add(self, mesh: Any, **how: Any) -> Any:
        how = {"show_scalar_bar": "scalar_bar_args" in how, "line_width": _BAND * _POINT} | how
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


# The direction to the viewer, in degrees: in front, from the right, a little from above.
_ELEVATION, _AZIMUTH = 20.0, -58.0
# An axis crosses the foundation if its share in the normal is at least this.
_ALONG = 0.9
# The view of Gamma_C from below is turned to the side by this share.
_ASLANT = 0.55
# Free space around Gamma_C, which shows the body around it, as a share of its extent.
_AROUND = 0.12


class Camera(NamedTuple):
    """A parallel projection onto a picture of ``width`` by ``height``, in units of length.

    The rows of ``frame`` (3, 3) point to the right, up and at the viewer.
    """

    frame: FloatArray
    centre: FloatArray
    width: float
    height: float


def camera(points: FloatArray, towards: FloatArray) -> Camera:
    """The camera whose picture shows all points (k, 3), with z upwards."""
    frame = style.view_frame(towards)
    seen = points @ frame.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    width, height, _ = np.maximum(high - low, 1e-9 + 1e-3 * (high - low).max())
    return Camera(frame, 0.5 * (low + high) @ frame, float(width), float(height))


def from_the_side(normal: FloatArray) -> FloatArray:
    """The direction to a viewer for whom the foundation, on the side of ``normal``, is behind."""
    up, around = np.radians([_ELEVATION, _AZIMUTH])
    towards = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    return towards - 2.0 * max(float(towards @ normal), 0.0) * normal


def across(normal: FloatArray) -> FloatArray:
    """The axis along the foundation that points most at the viewer from the side."""
    side = from_the_side(normal)
    axis = int(np.argmax(np.abs(side) * (np.abs(normal) < _ALONG)))
    return np.sign(side[axis]) * np.eye(3)[axis]


def side_camera(body: Snapshot, factor: float) -> Camera:
    """The camera of a body and of its foundations."""
    parts = body.contact.parts()
    grounds = [foundation(contact, factor, body.size).reshape(-1, 3) for contact in parts]
    points = [body.x, style.deformed(body, factor), *grounds]
    # A tool that is drawn as a whole hides the body less than the ground does.
    seen = any(len(tool(contact, factor)) for contact in parts)
    behind = np.zeros(3) if seen else mean_normal(body.contact)
    return camera(np.vstack(points), from_the_side(behind))


def contact_camera(body: Snapshot, contact: ContactMap, factor: float) -> Camera:
    """The camera of one contact of a body, which sees Gamma_C and a little of what is around."""
    points = style.deformed(body, factor)[contact.vertices]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    around = middle + (1.0 + 2.0 * _AROUND) * (points - middle)
    normal = mean_normal(contact)
    side = across(normal)
    return camera(around, normal + _ASLANT * (side - (side @ normal) * normal))


def mean_normal(contact: ContactMap) -> FloatArray:
    """The mean outward normal of Gamma_C; downwards if normals cancel or there are none."""
    mean: FloatArray = contact.points.normal.sum(axis=0) / max(len(contact.points), 1)
    length = float(np.linalg.norm(mean))
    return np.array(mean / length if length > 1e-3 else (0.0, 0.0, -1.0))


def views(body: Snapshot, factor: float) -> dict[str, tuple[Callable[[Scene], None], Camera]]:
    """The body, cut open, its locked zone, and each contact: how to draw them, by their titles."""
    side = side_camera(body, factor)
    strain = "|ε(u)| / M" if np.isfinite(body.locking_limit).any() else "|ε(u)|"
    makers: dict[str, tuple[Callable[[Scene], None], Camera]] = {}
    makers[f"Deformed body, {strain}"] = (Scene.deformed_body, side)
    makers[f"Cut open, {strain}"] = (Scene.cut_open, side)
    if body.locked.any():
        makers["Cells at the strain limit, |ε(u)| ≥ M"] = (Scene.locked_zone, side)
    for each in body.contact.parts():
        name, below = each.names[0] and f": {each.names[0]}", contact_camera(body, each, factor)
        makers[f"Contact pressure{name}"] = (Scene.pressure, below)
        makers[f"Open, stick and slip{name}"] = (Scene.states, below)
    return makers


def render(body: Snapshot) -> dict[str, Image]:
    """The views (h, w, 3) of a body by their titles."""
    factor = style.magnification(body)
    # One plotter for all pictures: an X server without clients may end.
    size = [_FINER * length for length in SIZE]
    plotter: Any = pv.Plotter(off_screen=True, lighting="none", window_size=size)
    plotter.set_background("white")
    plotter.add_light(pv.Light(position=(-0.5, 0.9, 1.4), light_type="camera light"))
    # Depth peeling, which glass takes, does not work with several samples for each pixel.
    plotter.render_window.SetMultiSamples(0)
    plotter.enable_depth_peeling()
    drawn = {}
    for title, (draw, seen) in views(body, factor).items():
        for name in list(plotter.scalar_bars.keys()):
            plotter.remove_scalar_bar(name, render=False)
        plotter.clear_actors()
        draw(Scene(plotter, body, factor, seen.frame[2]))
        right, up, towards = seen.frame
        centre = seen.centre + _BESIDE * seen.width * right
        plotter.camera.position = centre + 10.0 * max(seen.width, seen.height) * towards
        plotter.camera.focal_point, plotter.camera.up = centre, up
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = _ROOM * max(seen.height, seen.width * SIZE[1] / SIZE[0])
        plotter.reset_camera_clipping_range()
        # The arrows along the axes of an earlier picture would be turned one picture late.
        plotter.add_axes(viewport=(0.0, 0.0, 0.25, 0.25))
        plotter.render()
        image = np.asarray(plotter.screenshot(return_img=True))[..., :3]
        blocks = image.reshape(SIZE[1], _FINER, SIZE[0], _FINER, 3).astype(np.uint16)
        drawn[title] = (blocks.sum(axis=(1, 3)) // _FINER**2).astype(np.uint8)
    plotter.close()
    return drawn


def main(source: Path, target: Path, seconds: int) -> None:
    """Render the views of a snapshot into a file of NumPy."""
    # If a graphics driver hangs, the process that has started this one may be gone.
    signal.alarm(seconds)
    images: dict[str, Any] = dict(render(load(source)))
    with target.open("wb") as stream:
        np.savez(stream, **images)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
