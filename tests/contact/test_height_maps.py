"""A measured surface as a foundation: heights in a CSV or NumPy file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block

from contact_locking import InputError, StudySolution, solve
from contact_locking.arrays import FloatArray
from contact_locking.shapes.tool_files import read_heights

X, Y = np.linspace(-0.25, 1.25, 16), np.linspace(-0.25, 1.25, 11)


def heights(x: FloatArray, y: FloatArray) -> FloatArray:
    """A plane that enters the block at its left and leaves it at its right."""
    return np.asarray(0.01 - 0.02 * x + 0.004 * y)


@pytest.fixture
def grid() -> FloatArray:
    return heights(*np.meshgrid(X, Y))


@pytest.fixture
def folder(tmp_path: Path, comm: MPI.Intracomm) -> Path:
    """The same folder on all ranks."""
    found: Path = comm.bcast(tmp_path)
    return found


def pressed(foundation: dict[str, Any]) -> StudySolution:
    contact = {"on": "bottom", "foundation": foundation}
    return solve(block(3, 0.25, contact=contact, penalty__n=1e4))


def test_a_height_map_gives_what_the_half_space_gives(folder: Path, grid: FloatArray) -> None:
    file = folder / "map.npy"
    if MPI.COMM_WORLD.rank == 0:
        np.save(file, 1e3 * grid)
    MPI.COMM_WORLD.barrier()
    spacing = [1e3 * (X[1] - X[0]), 1e3 * (Y[1] - Y[0])]
    surface = {"file": str(file), "spacing": spacing, "scale": 1e-3, "shift": [-0.25, -0.25, 0.0]}
    measured = pressed({"surface": surface})
    plane = pressed({"half_space": {"point": [0, 0, 0.01], "normal": [0.02, -0.004, 1.0]}})
    assert measured.converged and 0.0 < plane.summary["contact_area"] < 0.9
    difference = measured.displacement.x.array - plane.displacement.x.array
    assert np.abs(difference).max(initial=0.0) < 1e-9
    assert not [text for text in measured.summary["warnings"] if "open" in text]


@pytest.mark.serial
def test_rows_in_any_order_are_the_grid(tmp_path: Path, grid: FloatArray) -> None:
    rows = np.column_stack([*(a.ravel() for a in np.meshgrid(X, Y)), grid.ravel()])
    np.random.default_rng(1).shuffle(rows)
    file, matrix = tmp_path / "rows.csv", tmp_path / "matrix.csv"
    np.savetxt(file, rows, delimiter=",", header="x (mm),y (mm),z (mm)", comments="")
    np.savetxt(matrix, grid, delimiter=",")
    (points, triangles), (shifted, same) = (
        read_heights(file, None),
        read_heights(matrix, (X[1] - X[0], Y[1] - Y[0])),
    )
    assert np.allclose(points, shifted + np.array([X[0], Y[0], 0.0]))
    assert np.array_equal(triangles, same) and len(triangles) == 2 * 15 * 10
    a, b, c = points[triangles].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()


@pytest.mark.serial
@pytest.mark.parametrize(
    ("content", "spacing", "message"),
    [
        ("0,0,1\n1,0,1\n0,1,1\n", None, "do not fill a rectangular grid"),
        ("0,0\n1,0\n", None, "has 2 columns, not x, y, z; for a grid of heights give spacing"),
        ("0,0,1\n1,0,nan\n0,1,1\n1,1,1\n", None, "1 of its numbers are not finite, the first in"),
        ("1,2,3\n", (1.0, 1.0), "is no surface: its grid has 1 by 3 heights"),
        ("1;2;3\n4;5;6\n", (1.0, 1.0), "cannot be read as rows of numbers"),
    ],
)
def test_files_that_are_no_height_maps_are_refused(
    tmp_path: Path, content: str, spacing: tuple[float, float] | None, message: str
) -> None:
    file = tmp_path / "map.csv"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_heights(file, spacing)


@pytest.mark.serial
def test_objects_in_a_numpy_file_are_not_loaded(tmp_path: Path) -> None:
    file = tmp_path / "map.npy"
    np.save(file, np.array([[{}, {}], [{}, {}]]), allow_pickle=True)
    with pytest.raises(InputError, match="cannot be read as rows of numbers"):
        read_heights(file, (1.0, 1.0))
