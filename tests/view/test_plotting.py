"""The picture: gathered the same on any number of ranks, drawn for every kind of body."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure
import matplotlib.image
import numpy as np
import pytest
from matplotlib.patches import PathPatch
from mpi4py import MPI
from solutions import DIVISIONS, KINDS, displacement, made_up, of_kind

from contact_locking.errors import NoRendering
from contact_locking.plain_text import per_cent
from contact_locking.results.contact_points import ContactPoints
from contact_locking.view import pictures
from contact_locking.view.pictures import offscreen, plane, style
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.snapshot import Snapshot


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


def test_without_pyvista_there_is_no_picture_in_space_and_the_reason_says_how_to_get_one(
    tmp_path: Path, comm: MPI.Intracomm, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(body: object) -> None:
        raise NoRendering("there is no PyVista")

    monkeypatch.setattr(offscreen, "views", fail)
    folder = comm.bcast(tmp_path)
    told = pictures.picture(of_kind(3, "locked"), folder)
    assert told is not None and "there is no PyVista\n" in told and "apt-get install" in told
    comm.Barrier()
    assert not list(folder.iterdir())


def test_a_picture_that_fails_says_why_on_every_rank_and_leaves_no_file(
    tmp_path: Path, comm: MPI.Intracomm
) -> None:
    folder = comm.bcast(tmp_path) / "missing"
    problem = pictures.picture(made_up(), folder)
    assert problem is not None and "No such file" in problem
    assert comm.allgather(problem) == [problem] * comm.size
    assert not folder.exists()


def test_a_displacement_that_is_not_finite_is_not_drawn(
    tmp_path: Path, comm: MPI.Intracomm
) -> None:
    solution = made_up()
    solution.displacement.x.array[:] = np.nan
    problem = pictures.picture(solution, comm.bcast(tmp_path))
    assert problem == "no picture was drawn: the displacement is not finite"


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


@pytest.mark.serial
def test_each_contact_has_a_panel_in_the_picture_of_a_plane_body() -> None:
    body = gather(of_kind(2, "with two contacts"))
    assert body is not None
    titles = [axes.get_title(loc="left") for axes in plane.figure(body).axes]
    assert [title for title in titles if title.startswith("On")] == [
        r"On $\Gamma_C$: bottom",
        r"On $\Gamma_C$: left, a \$part\$",
    ]


@pytest.mark.serial
def test_what_is_left_of_tractions_at_an_open_contact_is_flat() -> None:
    body = gather(of_kind(2, "with two contacts"))
    assert body is not None
    points = body.contact.points
    points.pressure[:], points.bound[:], points.traction[:] = 150.0, 0.0, 0.0
    points.pressure[points.contact == 1] = 1e-7
    heights = [
        axes.get_ylim()[1] for axes in plane.figure(body).axes if axes.get_ylabel() == "traction"
    ]
    assert heights[0] > 150.0 and heights[1] == 150.0


@pytest.mark.serial
def test_a_picture_of_a_wide_body_has_no_empty_space() -> None:
    heights = []
    for factor in (1.0, 0.1):
        body = gather(of_kind(2, "locked"))
        assert body is not None
        body.x[:, 1] *= factor
        body.displacement[:] *= 0.0
        heights.append(plane.figure(body).get_figheight())
    assert 8.0 < heights[0] < 9.0
    assert heights[0] - heights[1] > 2.0


def test_two_foundations_with_gaps_of_their_own_are_no_curved_one() -> None:
    body = gather(of_kind(2, "with two contacts"))
    if body is None:
        return
    largest = float(np.linalg.norm(body.displacement, axis=1).max())
    body.displacement[:] *= 0.001 / largest
    body.contact.points.gap[body.contact.points.contact == 1] = 0.3
    assert style.magnification(body) == 50.0


def test_the_corner_of_two_contacts_is_a_point_of_both() -> None:
    solution = of_kind(2, "with two contacts")
    solution.contacts[1].smoothed_stress[:] -= 1.0
    body = gather(solution)
    if body is None:
        return
    bottom, left = body.contact.parts()
    assert bottom.names == ("bottom",) and left.names == ("left, a $part$",)
    assert np.ptp(bottom.points.x[:, 1]) == np.ptp(left.points.x[:, 0]) == 0.0
    assert len(set(bottom.vertices) & set(left.vertices)) == 1
    for part in (bottom, left):
        assert np.array_equal(part.smoothed, -part.points.pressure - part.points.contact)
        assert body.x[part.vertices] == pytest.approx(part.points.x)
        assert np.array_equal(np.unique(part.facets), np.arange(len(part.points)))


@pytest.mark.serial
@pytest.mark.parametrize("side", ["left", "bottom", "right", "top"])
def test_friction_has_the_sign_of_the_axis_that_it_is_drawn_over(side: str) -> None:
    upright = side in ("left", "right")
    normal = np.array({"left": [-1, 0], "right": [1, 0], "bottom": [0, -1], "top": [0, 1]}[side])
    s = np.linspace(1.0, 0.0, 5)
    x = np.zeros((5, 2))
    x[:, int(upright)] = s
    friction = np.zeros((5, 2))
    friction[:, int(upright)] = np.arange(1.0, 6.0)
    zero, none = np.zeros(5), np.zeros((5, 2))
    points = ContactPoints(
        x, np.tile(normal, (5, 1)), zero, none, zero, zero, friction, zero,
        np.zeros(5, dtype=np.int64), np.zeros(5, dtype=np.int64),
    )  # fmt: skip
    facets = np.column_stack([np.arange(4), np.arange(1, 5)])
    figure = matplotlib.figure.Figure()
    panel, strip = figure.subplots(2, 1)
    plane.draw_tractions(panel, strip, points, facets, 5.0)
    curve = next(line for line in panel.lines if "friction" in str(line.get_label()))
    assert np.array_equal(np.asarray(curve.get_ydata()), np.arange(1.0, 6.0))
    assert np.array_equal(np.asarray(curve.get_xdata()), s)


@pytest.mark.serial
def test_the_picture_counts_what_it_hatches() -> None:
    body = gather(made_up(2))
    assert body is not None
    figure = plane.figure(body)
    share = body.locked_fraction
    assert any(per_cent(share) in text.get_text() for text in figure.texts)
    patches = [patch for axes in figure.axes for patch in axes.patches]
    (cells,) = [patch for patch in patches if isinstance(patch, PathPatch)]
    assert cells.get_hatch() == "////"
    assert len(np.asarray(cells.get_path().vertices)) == 4 * body.locked.sum()
