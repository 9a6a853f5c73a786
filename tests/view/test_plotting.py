"""The picture: gathered the same on any number of ranks, drawn for every kind of body."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure
import matplotlib.image
import numpy as np
import pytest
from mpi4py import MPI
from solutions import DIVISIONS, KINDS, displacement, made_up, of_kind

from contact_locking.view import pictures
from contact_locking.view.pictures import style
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.plane import draw_tractions
from contact_locking.view.pictures.style import Snapshot


def snapshot(dim: int = 2, **changes: Any) -> Snapshot | None:
    return gather(made_up(dim, **changes))


@pytest.mark.parametrize("dim", [2, 3])
def test_every_vertex_and_cell_is_gathered_once(dim: int, comm: MPI.Intracomm) -> None:
    body = snapshot(dim)
    assert (body is not None) == (comm.rank == 0)
    if body is None:
        return
    assert len(body.x) == len(np.unique(np.round(body.x, 9), axis=0)) == (DIVISIONS + 1) ** dim
    edges = body.x[body.cells[:, 1:]] - body.x[body.cells[:, :1]]
    volume = np.abs(np.linalg.det(edges)).sum() / (2 if dim == 2 else 6)
    assert volume == pytest.approx(1.0)
    assert body.displacement == pytest.approx(displacement(body.x.T).T)
    assert body.locked.sum() == len(body.cells) / 2
    assert (body.locked == (body.x[body.cells][:, :, -1].mean(axis=1) > 0.5)).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_the_gathered_boundary_belongs_to_its_cells_and_contact_is_the_bottom(dim: int) -> None:
    body = snapshot(dim)
    if body is None:
        return
    assert len(body.boundary) == (4 * DIVISIONS if dim == 2 else 12 * DIVISIONS**2)
    for facet, cell in zip(body.boundary, body.boundary_cell, strict=True):
        assert np.isin(facet, body.cells[cell]).all()
    contact = body.contact
    assert body.x[contact.vertices] == pytest.approx(contact.points.x)
    assert contact.smoothed == pytest.approx(-contact.points.pressure)
    assert len(contact.facets) == (DIVISIONS if dim == 2 else 2 * DIVISIONS**2)
    assert contact.facets.min() >= 0
    assert np.abs(contact.points.x[contact.facets][:, :, -1]).max() == 0.0


@pytest.mark.serial
@pytest.mark.parametrize("kind", KINDS)
def test_a_picture_in_the_plane_is_drawn(kind: str, tmp_path: Path, comm: MPI.Intracomm) -> None:
    settings = dict(matplotlib.rcParams)
    folder = comm.bcast(tmp_path)
    assert pictures.picture(of_kind(2, kind), folder) is None
    assert dict(matplotlib.rcParams) == settings
    if comm.rank == 0:
        image = matplotlib.image.imread(folder / "picture.png")
        assert image.shape[1] == round(7.2 * style.DPI) and min(image.shape[:2]) > 800
        assert image[:, :, :3].std() > 0.05


@pytest.mark.serial
def test_the_legend_has_each_name_once_for_a_contact_of_several_lines() -> None:
    body = snapshot()
    assert body is not None
    contact, (axes, strip) = body.contact, matplotlib.figure.Figure().subplots(2)
    facets = np.delete(contact.facets, 1, axis=0)
    draw_tractions(axes, strip, contact.points, facets, {}, 1.0, contact.smoothed)
    assert len(axes.get_legend_handles_labels()[1]) == 4


def test_a_picture_that_fails_says_why_on_every_rank_and_leaves_no_file(
    tmp_path: Path, comm: MPI.Intracomm
) -> None:
    folder = comm.bcast(tmp_path) / "missing"
    problem = pictures.picture(made_up(), folder)
    assert problem is not None and "No such file" in problem
    assert comm.allgather(problem) == [problem] * comm.size
    assert not folder.exists()


@pytest.mark.serial
def test_only_a_small_displacement_over_a_uniform_gap_is_magnified() -> None:
    body = snapshot()
    if body is None:
        return
    largest = float(np.linalg.norm(body.displacement, axis=1).max())
    assert largest > 0.03 and style.magnification(body) == 1.0
    body.displacement[:] *= 0.001 / largest
    assert style.magnification(body) == 50.0
    body.contact.points.gap[:] = 0.3
    assert style.magnification(body) == 50.0
    body.contact.points.gap[0] = 0.31
    assert style.magnification(body) == 1.0


def test_a_displacement_that_is_not_finite_is_not_drawn(
    tmp_path: Path, comm: MPI.Intracomm
) -> None:
    solution = made_up()
    solution.displacement.x.array[:] = np.nan
    problem = pictures.picture(solution, comm.bcast(tmp_path))
    assert problem == "no picture was drawn: the displacement is not finite"
