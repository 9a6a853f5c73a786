"""Gmsh without output and with reproducible meshes."""

import errno
import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from contact_locking.files.atomic import staging

from .geometry import Geometry

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
