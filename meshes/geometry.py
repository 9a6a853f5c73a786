"""The base class of geometries, and Gmsh without output and with reproducible meshes.

A geometry has checked parameters, named groups, a graded element size, and curved sides, onto which
the nodes of a later refinement are moved.
"""

import errno
import math
import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from numbers import Real
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.files import staging

# A node at this share of the radius from the circle or sphere counts as a node of it.
_ON = 1e-9


@dataclass(frozen=True)
class Curved:
    """``|x - centre| = radius`` for all nodes that belong to every one of ``groups``.

    ``groups`` are names of boundary parts, or of the regions on both sides of an interface.  If
    ``level``, the nodes lie in the plane through the centre across the last axis as well: they lie
    on a circle in space.
    """

    groups: tuple[str, ...]
    centre: tuple[float, ...]
    radius: float
    level: bool = False

    def put(self, points: FloatArray, nodes: IntArray) -> None:
        """Move those ``nodes`` (k,) of ``points`` (m, d) onto the curve that are not on it yet."""
        offset = points[nodes] - np.array(self.centre)
        if self.level:
            offset[:, -1] = 0.0
        lengths = np.linalg.norm(offset, axis=1)
        on_curve = self.centre + offset * (self.radius / lengths)[:, None]
        moved = np.linalg.norm(on_curve - points[nodes], axis=1) > _ON * self.radius
        points[nodes[moved]] = on_curve[moved]


def rounded(
    curves: tuple[Curved, ...], points: FloatArray, belongs: Callable[[str], BoolArray]
) -> FloatArray:
    """Copies of ``points`` (m, d), moved onto the curves that they belong to.

    ``belongs`` gives for the name of a group the mask (m,) of its nodes.
    """
    points = points.copy()
    # A curve where two sides meet comes before the sides.
    for curve in sorted(curves, key=lambda curve: -len(curve.groups)):
        nodes = np.flatnonzero(np.all([belongs(name) for name in curve.groups], axis=0))
        curve.put(points, nodes)
    return points


Point = tuple[float, float, float]

#: The squares and cubes of lengths in this range neither underflow nor overflow.
LENGTHS = (1e-50, 1e50)
#: Lengths below this share of the largest length are near the tolerances of the geometry kernel.
SMALLEST_SHARE = 1e-6
#: The number of digits of the lengths for Gmsh, in units of the largest length.
DIGITS = 14
#: A larger number of cells counts as a mistake in an element size.
MOST_CELLS = 20_000_000
#: Growth of the element size per unit of distance from the refined zone.
GROWTH = 0.3
# The points along a side from which Gmsh measures distances, by dimension.
_MOST_POINTS = {2: 100_000, 3: 300}


def parameter(default: Any, unit: str, description: str) -> Any:
    """A dataclass field that carries its unit and its description to the schema."""
    return field(default=default, metadata={"unit": unit, "description": description})


@dataclass(frozen=True)
class Zone:
    """The region meshed with ``h_contact``, as one of Gmsh's mesh size fields.

    ``kind`` is "Box" or "Ball", and ``options`` are the options of this field. ``measure`` is the
    area (2D) or volume (3D) of the body in the region, for the estimate of the number of cells.
    """

    kind: str
    options: dict[str, float]
    measure: float


@dataclass(frozen=True, kw_only=True)
class Geometry(ABC):
    """A body that Gmsh can mesh with first-order simplices or boxes.

    A subclass defines the parameters as fields, the shape, and the name of every part of the
    boundary. Raises ValueError("name: reason") for a parameter that cannot be used.
    """

    h: float = parameter(0.1, "length", "target element size")
    h_contact: float | None = parameter(
        None, "length", "element size near contact.on, from where it grows to h; null: h"
    )
    cells: Literal["simplex", "box"] = parameter(
        "simplex", "1", "triangles and tetrahedra, or quadrilaterals and hexahedra"
    )

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.name == "cells":
                if value not in ("simplex", "box"):
                    raise ValueError(f"cells: must be simplex or box, not {value!r}")
            elif isinstance(entry.default, bool):
                if not isinstance(value, bool):
                    raise ValueError(f"{entry.name}: must be true or false, not {value!r}")
            elif isinstance(entry.default, float) or (entry.default is None and value is not None):
                object.__setattr__(self, entry.name, length(entry.name, value))
        self.validate()
        if self.subdivides and self.dim == 3:
            # Gmsh divides tetrahedra into hexahedra, some of which are folded at curved sides.
            raise ValueError(
                "cells: box in 3D is for a block or a stack with structured: true; give another "
                "body of hexahedra as a mesh file"
            )
        at_most("h", self.h, self.thickness, "the thickness of the body")
        at_most("h_contact", self.finest, self.h, "h")
        for name, value in self.lengths():
            if value < SMALLEST_SHARE * self.extent:
                raise ValueError(
                    f"{name}: {value:g} is less than {SMALLEST_SHARE:g} of the largest length, "
                    f"{self.extent:g}"
                )
        cells = self.estimated_cells()
        if cells > MOST_CELLS:
            # Name h_contact if the contact zone holds most of the cells, else h.
            coarse = self._cells(self.measure, self.h)
            culprit = "h" if coarse > 0.5 * cells else "h_contact"
            raise ValueError(
                f"{culprit}: {getattr(self, culprit):g} would make about {cells:.0e} cells; "
                f"at most {MOST_CELLS:.0e} are allowed"
            )

    @property
    @abstractmethod
    def dim(self) -> int:
        """The dimension of the body, 2 or 3."""

    @property
    @abstractmethod
    def thickness(self) -> float:
        """The smallest width of the body, and so the largest reasonable ``h``."""

    @property
    @abstractmethod
    def measure(self) -> float:
        """The area (2D) or volume (3D) of the exact, curved body."""

    @property
    @abstractmethod
    def zone(self) -> Zone:
        """The region that ``h_contact`` refines for contact on ``contact_names``."""

    @property
    @abstractmethod
    def contact_names(self) -> tuple[str, ...]:
        """The boundary parts in the zone, where contact is by default."""

    @property
    @abstractmethod
    def facet_names(self) -> tuple[str, ...]:
        """The names of the boundary parts, which cover the boundary without overlap."""

    @property
    def cell_names(self) -> tuple[str, ...]:
        """The names of the regions, which cover the body without overlap."""
        return ("body",)

    @property
    def curved(self) -> tuple[Curved, ...]:
        """The curved sides; the nodes that a refinement adds there are moved onto them."""
        return ()

    @abstractmethod
    def shape(self, occ: Any) -> dict[str, list[int]]:
        """Add the body to the OpenCASCADE kernel ``occ``; returns the tags of each named region."""

    @property
    def bodies(self) -> int:
        """The number of parts that share no nodes."""
        return 1

    @abstractmethod
    def facet_name(self, centre: Point, region: str) -> str:
        """The name of the boundary part of an entity with this centre of mass beside a region."""

    @abstractmethod
    def validate(self) -> None:
        """Check the parameters of this geometry; its lengths are positive and finite already."""

    def lengths(self) -> Iterator[tuple[str, float]]:
        """The names and values of the given parameters that are lengths."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            if entry.metadata.get("unit") == "length" and value is not None:
                for number in value if isinstance(value, tuple) else (value,):
                    yield entry.name, number

    @property
    def extent(self) -> float:
        """The largest length among the parameters of the body, the unit of length for Gmsh."""
        return max(value for name, value in self.lengths() if name not in ("h", "h_contact"))

    def in_units_of(self, unit: float) -> Self:
        """The same geometry in another unit of length, rounded to ``DIGITS``.

        With this rounding the mesh of a body does not depend on the unit of length in the study.
        """

        def scaled(value: Any) -> Any:
            if isinstance(value, tuple):
                return tuple(map(scaled, value))
            return None if value is None else float(f"{value / unit:.{DIGITS - 1}e}")

        names = [entry.name for entry in fields(self) if entry.metadata.get("unit") == "length"]
        return replace(self, **{name: scaled(getattr(self, name)) for name in names})

    @property
    def subdivides(self) -> bool:
        """Whether cells are made simplices first, and then divided into boxes of half the size."""
        return self.cells == "box"

    @property
    def finest(self) -> float:
        """The smallest element size: ``h_contact``, or ``h`` without it."""
        return self.h if self.h_contact is None else self.h_contact

    def estimated_cells(self) -> float:
        """The expected number of cells: measure over cell measure, summed over both sizes."""
        coarse = self._cells(self.measure, self.h)
        if self.h_contact is None:
            return coarse
        return coarse + self._cells(self.zone.measure, self.h_contact)

    def build(self, model: Any, contact: Collection[str] = ()) -> None:
        """Shape, name and mesh the body in the empty current ``model`` = ``gmsh.model``.

        ``contact`` names the boundary parts that ``h_contact`` refines; empty: ``contact_names``.
        """
        parts = self.shape(model.occ)
        model.occ.synchronize()
        # A point without a curve, such as the centre of an arc, would become a node without a cell.
        loose = [
            (0, tag) for _, tag in model.getEntities(0) if not len(model.getAdjacencies(0, tag)[0])
        ]
        model.occ.remove(loose)
        model.occ.synchronize()
        facets: dict[str, list[int]] = {name: [] for name in self.facet_names}
        region_of = {tag: name for name, tags in parts.items() for tag in tags}
        # The outer boundary only: an interface between two regions has no name.
        for _, tag in model.getBoundary(model.getEntities(self.dim), oriented=False):
            ((beside,), _) = model.getAdjacencies(self.dim - 1, tag)
            centre = model.occ.getCenterOfMass(self.dim - 1, tag)
            facets[self.facet_name(centre, region_of[beside])].append(tag)
        for dim, groups in ((self.dim, parts), (self.dim - 1, facets)):
            for number, (name, tags) in enumerate(groups.items(), start=1):
                model.addPhysicalGroup(dim, tags, number, name=name)
        sides = [tag for name in contact for tag in facets[name]]
        self.set_sizes(model, [] if set(contact) <= set(self.contact_names) else sides)
        if self.cells == "box":
            for dim, tag in model.getEntities(2):
                model.mesh.setRecombine(dim, tag)
        model.mesh.generate(self.dim)

    def set_sizes(self, model: Any, sides: Sequence[int] = ()) -> None:
        """Prescribe the element size: ``h_contact`` in the zone, growing outside it up to ``h``.

        In place of the zone there are two layers of elements at the boundary entities ``sides``.
        """
        size = model.mesh.field
        # Gmsh divides by the thickness, so it may be small but not zero.
        thickness = max((self.h - self.finest) / GROWTH, 1e-3 * self.h)
        factor = 2.0 if self.subdivides else 1.0
        least, most = factor * self.finest, factor * self.h
        if sides and self.h_contact is not None:
            distance = size.add("Distance")
            size.setNumbers(distance, "CurvesList" if self.dim == 2 else "SurfacesList", sides)
            # Gmsh measures the distance from so many points along each side.
            points = min(self.extent / self.finest, _MOST_POINTS[self.dim])
            size.setNumber(distance, "Sampling", math.ceil(points) + 1)
            tag, near = size.add("Threshold"), 2 * self.finest
            values = {"InField": distance, "DistMin": near, "DistMax": near + thickness}
            values |= {"SizeMin": least, "SizeMax": most}
        else:
            tag = size.add(self.zone.kind)
            values = self.zone.options | {"VIn": least, "VOut": most, "Thickness": thickness}
        for option, value in values.items():
            size.setNumber(tag, option, value)
        size.setAsBackgroundMesh(tag)

    def refine_second(self, model: Any, size: float) -> None:
        """Let no element of the second region be larger than ``size``, beside :meth:`set_sizes`."""
        fields = model.mesh.field
        (region,) = model.getEntitiesForPhysicalGroup(self.dim, 2)
        present = max(fields.list())
        in_second, both = fields.add("Constant"), fields.add("Min")
        fields.setNumbers(in_second, "SurfacesList" if self.dim == 2 else "VolumesList", [region])
        fields.setNumber(in_second, "VIn", size)
        fields.setNumbers(both, "FieldsList", [present, in_second])
        fields.setAsBackgroundMesh(both)

    def at(self, coordinate: float, plane: float) -> bool:
        """Whether a coordinate is the coordinate of a plane, up to rounding in the kernel."""
        return abs(coordinate - plane) <= 1e-6 * self.thickness

    def _cells(self, measure: float, h: float) -> float:
        if self.cells == "box":
            return measure / h**self.dim
        # The measures of the equilateral triangle and the regular tetrahedron with edge 1.
        cell = math.sqrt(3) / 4 if self.dim == 2 else math.sqrt(2) / 12
        return measure / (cell * h**self.dim)


def length(name: str, value: Any) -> float:
    """``value`` as a float, if it is a usable length; raises ValueError otherwise."""
    number = real(name, value)
    if number <= 0:
        raise ValueError(f"{name}: must be positive, not {number:g}")
    if not LENGTHS[0] <= number <= LENGTHS[1]:
        raise ValueError(
            f"{name}: {number:g} is outside {LENGTHS[0]:g} to {LENGTHS[1]:g}; "
            "choose another unit of length"
        )
    return number


def at_most(name: str, value: float, most: float, what: str) -> None:
    """Raise ValueError for a parameter above ``most``, which ``what`` names, but for rounding."""
    if value > most * (1 + 1e-9):
        raise ValueError(f"{name}: {value:g} is more than {what}, {most:g}")


def below(name: str, value: float, end: float, what: str) -> None:
    """Raise ValueError for a parameter that is not below ``end``, which ``what`` names."""
    if value >= end:
        raise ValueError(f"{name}: {value:g} is not less than {what}, {end:g}")


def real(name: str, value: Any) -> float:
    """``value`` as a finite float; raises ValueError if it is not one."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"{name}: must be a number, not {value!r}")
    if not math.isfinite(value):
        raise ValueError(f"{name}: must be finite, not {float(value):g}")
    return float(value)


def vector(name: str, values: Any, dim: int) -> tuple[float, ...]:
    """``values`` as ``dim`` finite floats; raises ValueError if they are not."""
    if not isinstance(values, list | tuple) or len(values) != dim:
        raise ValueError(f"{name}: must be a list of {dim} numbers in {dim}D, not {values!r}")
    return tuple(real(name, value) for value in values)


def dimension(value: Any) -> int:
    """``value`` as a dimension, 2 or 3; raises ValueError if it is neither."""
    if isinstance(value, bool) or value not in (2, 3):
        raise ValueError(f"dim: must be 2 or 3, not {value!r}")
    return int(value)


OPTIONS = {
    "General.Terminal": 0,
    "General.NumThreads": 1,
    "Mesh.RandomSeed": 1,
    "Mesh.Algorithm": 6,  # frontal Delaunay
    "Mesh.Algorithm3D": 1,  # Delaunay
    "Mesh.ElementOrder": 1,
    "Mesh.SubdivisionAlgorithm": 0,
    # Only the size field of the geometry sets the element size.
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeFromCurvature": 0,
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.MshFileVersion": 4.1,
    "Mesh.Binary": 0,
    "Mesh.SaveAll": 0,
}

_END = b"$EndElements\n"


@contextmanager
def empty_model(model_name: str = "body") -> Iterator[Any]:
    """An empty ``gmsh.model`` with ``OPTIONS``, until the end of the block; for one process.

    The signal handlers, the command line and a Gmsh that the caller has initialised, with its
    options, do not change.
    """
    import gmsh

    ours = not gmsh.isInitialized()
    if ours:
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    before = {name: gmsh.option.getNumber(name) for name in OPTIONS}
    current = None if ours else gmsh.model.getCurrent()
    try:
        for name, value in OPTIONS.items():
            gmsh.option.setNumber(name, value)
        gmsh.model.add(model_name)
        yield gmsh.model
    finally:
        if ours:
            gmsh.finalize()
        else:
            gmsh.model.setCurrent(model_name)
            gmsh.model.remove()
            for name, value in before.items():
                gmsh.option.setNumber(name, value)
            gmsh.model.setCurrent(current)


@contextmanager
def build(
    geometry: Geometry, model_name: str = "body", contact: Collection[str] = ()
) -> Iterator[Any]:
    """``gmsh.model`` with the mesh of ``geometry``, until the end of the block; for one process.

    ``contact`` names the boundary parts that ``h_contact`` refines, by default those of
    ``geometry.contact_names``.

    Raises RuntimeError if Gmsh cannot make the mesh. See also `empty_model`.
    """
    import gmsh

    unit = geometry.extent
    with empty_model(model_name) as model:
        # Gmsh divides all cells into quadrilaterals, if the geometry asks for it.
        gmsh.option.setNumber("Mesh.SubdivisionAlgorithm", 1 if geometry.subdivides else 0)
        try:
            # The geometry kernel has absolute tolerances for lengths around 1.
            geometry.in_units_of(unit).build(model, contact)
            if unit != 1.0:
                model.mesh.affineTransform([unit, 0, 0, 0, 0, unit, 0, 0, 0, 0, unit, 0])
        except Exception as error:  # Gmsh raises Exception itself
            raise RuntimeError(f"Gmsh cannot mesh {geometry}: {error}") from error
        yield model


def write(geometry: Geometry, path: str | os.PathLike[str], contact: Collection[str] = ()) -> None:
    """Mesh ``geometry`` and write a Gmsh file (format 4.1), complete or not at all.

    ``contact`` as for `build`.  Raises ValueError if the name does not end in .msh,
    and OSError if the file cannot be written.
    """
    import gmsh

    target = Path(path)
    if target.suffix != ".msh":
        raise ValueError(f"the name of a Gmsh file ends in .msh, {target.name} does not")
    with staging(target.parent) as folder:
        unfinished = folder / target.name
        unfinished.touch()
        with build(geometry, target.stem, contact):
            gmsh.write(str(unfinished))
        check_complete(unfinished)
        os.replace(unfinished, target)


def check_complete(path: Path) -> None:
    """Raise OSError for a file without its last line, because Gmsh does not report a full disk."""
    with path.open("rb") as stream:
        stream.seek(max(0, path.stat().st_size - len(_END)))
        if stream.read().strip() != _END.strip():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
