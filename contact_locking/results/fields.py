"""The fields of a solution in VTK's HDF5 format, which ParaView, PyVista and h5py read."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx.plot import vtk_mesh

from contact_locking.arrays import FloatArray
from contact_locking.fem import compiled
from contact_locking.results.solution import Solution

FIELD_NAMES = (
    "displacement",
    "strain_norm",
    "locked",
    "elastic_stress",
    "locking_stress",
    "von_mises",
    "error_indicator",
    "contact_pressure",
    "tangential_traction",
    "smoothed_stress",
    "contact_state",
)

# What HDF5 adds to the values of a dataset.
_BYTES_OF_A_DATASET = 4096


def discontinuous(solution: Solution) -> list[fem.Function]:
    """All fields as discontinuous functions of the displacement's degree.

    One element contains the displacements and the strains, so that a file has one mesh.  Values
    that are constant in a cell are copied.  Of strains that vary in a cell the norm is |eps(u)| at
    each node, unless the body is axisymmetric.  The other fields of the space of strains are
    extended to the nodes as the functions that they are, except ``locked``, which is that of the
    point beside a node and stays between 0 and 1.
    """
    degree, mesh = solution.element.degree, solution.domain.mesh
    spaces: dict[tuple[int, ...], fem.FunctionSpace] = {}
    copies = []
    for name in FIELD_NAMES:
        function = getattr(solution, name)
        if function is None:
            continue
        shape = function.ufl_shape
        if shape not in spaces:
            element = ("DG", degree, shape) if shape else ("DG", degree)
            spaces[shape] = fem.functionspace(mesh, element)
        copy = fem.Function(spaces[shape], name=name)
        _fill(copy, function, name, solution)
        copies.append(copy)
    return copies


def _fill(copy: fem.Function, function: fem.Function, name: str, solution: Solution) -> None:
    """Give a discontinuous function the values of a field; collective."""
    space = copy.function_space
    source, target = function.function_space.dofmap, space.dofmap
    values = function.x.array.reshape(-1, source.bs)[source.list]
    # On the axis of an axisymmetric body the hoop strain is no number at a node.
    kinematics = solution.element.kinematics
    element, is_constant = solution.element, values.shape[1] == 1
    is_nodal = not function.function_space.element.basix_element.discontinuous
    # Whether there is a point of the strains beside each node.
    each = source.list.shape[1] == target.list.shape[1]
    varies = element.strain_degree > 0 and not kinematics.axisymmetric
    if name == "strain_norm" and varies:
        eps = kinematics.strain(solution.displacement)
        norm = ufl.sqrt(ufl.inner(eps, eps))
        copy.interpolate(compiled.interpolation(norm, space))
    elif is_constant or is_nodal or (name == "locked" and each):
        # A constant has one value in a cell, which every node receives.
        copy.x.array.reshape(-1, target.bs)[target.list] = values
    else:
        copy.interpolate(function)
        if name == "locked":
            copy.x.array[:] = np.clip(np.round(copy.x.array, 9), 0.0, 1.0)


def size(functions: list[fem.Function]) -> int:
    """An upper bound of the bytes that :func:`append` writes on this rank for the first time."""
    dofmap = functions[0].function_space.dofmap
    values = sum({0: 1, 1: 3, 2: 9}[len(function.ufl_shape)] for function in functions)
    return 8 * (values + 5) * dofmap.list.size + _BYTES_OF_A_DATASET * (len(functions) + 20)


def append(functions: list[fem.Function], path: Path, time: float, new: bool) -> None:
    """Append this rank's part of functions at a time to a file, after those of the ranks before it.

    The functions are those of :func:`discontinuous`.  The mesh of this rank's cells is added
    where the file is ``new``.  Raises OSError where HDF5 fails.
    """
    import h5py

    comm = functions[0].function_space.mesh.comm
    try:
        with h5py.File(path, "w" if new and comm.rank == 0 else "a") as file:
            group = file.require_group("VTKHDF")
            if new:
                _append_mesh(group, functions[0].function_space)
            if comm.rank == 0:
                _append_time(group, functions, time)
            for function in functions:
                _extend(group, f"PointData/{function.name}", values_at_nodes(function))
    except (OSError, RuntimeError) as error:  # with texts of many lines
        number = re.search(r"errno = (\d+)", str(error))
        code = int(number[1]) if number else errno.EIO
        raise OSError(code, os.strerror(code), str(path)) from error


def _append_mesh(group: Any, space: fem.FunctionSpace) -> None:
    cells, kinds, nodes = vtk_mesh(space)
    in_cell = space.dofmap.list.shape[1]
    links = cells.reshape(-1, in_cell + 1)[:, 1:].astype(np.int64)
    # The nodes of a cell are its own, so that offsets in the list of links are numbers of nodes.
    first = len(group["Points"]) if "Points" in group else 0
    offsets = first + in_cell * np.arange(len(links) + 1)
    _extend(group, "Offsets", offsets[1:] if "Offsets" in group else offsets)
    _extend(group, "Points", nodes[: links.size])
    _extend(group, "Connectivity", first + links.reshape(-1))
    _extend(group, "Types", kinds.astype(np.uint8))
    group.attrs["Version"] = [2, 0]
    group.attrs["Type"] = np.bytes_("UnstructuredGrid")
    numbers = {"Points": "Points", "Cells": "Types", "ConnectivityIds": "Connectivity"}
    for name, rows in numbers.items():
        group.require_dataset(f"NumberOf{name}", (1,), np.int64)[0] = len(group[rows])


def _append_time(group: Any, functions: list[fem.Function], time: float) -> None:
    """Where a time has its values; the mesh is that of the first time."""
    steps = group.require_group("Steps")
    _extend(steps, "Values", [time])
    steps.attrs["NSteps"] = len(steps["Values"])
    _extend(steps, "NumberOfParts", [1])
    for name in ("PartOffsets", "PointOffsets"):
        _extend(steps, name, [0])
    for name in ("CellOffsets", "ConnectivityIdOffsets"):
        _extend(steps, name, [[0]])
    for function in functions:
        name = f"PointData/{function.name}"
        _extend(steps, name.replace("/", "Offsets/"), [len(group[name]) if name in group else 0])


def values_at_nodes(function: fem.Function) -> FloatArray:
    """The values (k,), (k, 3) or (k, 9) at the nodes of this rank's cells."""
    shape, dofmap = function.ufl_shape, function.function_space.dofmap
    count = dofmap.index_map.size_local
    values = function.x.array[: count * dofmap.bs].reshape(count, *shape)
    in_space = np.pad(values, [(0, 0), *((0, 3 - n) for n in shape)])
    return in_space.reshape(count, 3 ** len(shape)) if shape else in_space


def _extend(group: Any, name: str, rows: Any) -> None:
    """Append rows to a dataset, which is made if there is none."""
    rows = np.asarray(rows)
    if name not in group:
        group.create_dataset(name, data=rows, maxshape=(None, *rows.shape[1:]))
        return
    count = len(group[name])
    group[name].resize(count + len(rows), axis=0)
    group[name][count:] = rows
