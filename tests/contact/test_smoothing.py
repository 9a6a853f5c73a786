"""R beside displacement conditions, and along parts of Gamma_C that are apart or fold back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI
from problems import block

from contact_locking import _compat
from contact_locking.arrays import FloatArray
from contact_locking.contact.coulomb import ConvolutionOperator
from contact_locking.contact.surface import ContactSurface, SurfaceMesh
from contact_locking.mesh.domain import Domain
from contact_locking.running.assembly import assemble
from contact_locking.study_file.parameters import Parameters

KERNELS = ("convolution", "helmholtz")


def gathered(comm: MPI.Intracomm, *columns: FloatArray) -> list[FloatArray]:
    """Columns over all nodes, in an order that no distribution changes."""
    rows = [np.concatenate(comm.allgather(column)) for column in columns]
    points = rows[0].reshape(len(rows[0]), -1)
    order = np.lexsort(np.round(points, 9).T[::-1])
    return [row[order] for row in rows]


def clamped(dim: int, kernel: str) -> Parameters:
    """A block that its left side holds, also at the edge of Gamma_C."""
    smoothing = {"kernel": kernel, "radius": 0.3}
    return block(dim, 0.1 if dim == 2 else 0.3, friction__smoothing=smoothing)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", KERNELS)
def test_a_constant_pressure_on_the_free_nodes_stays_beside_a_clamp(dim: int, kernel: str) -> None:
    problem = assemble(clamped(dim, kernel), MPI.COMM_WORLD)
    (contact,) = problem.contacts
    free = contact.free
    held = contact.surface.points[:, 0] < 1e-9
    assert (free == ~held).all()
    assert problem.domain.comm.allreduce(int(held.sum())) > 0
    # Held nodes carry no pressure; whatever stands there must not count.
    for at_held in (0.0, 7.0):
        smoothed = contact.friction.smoothing.apply(np.where(free, 3.0, at_held))
        assert smoothed[free] == pytest.approx(3.0, rel=1e-12)
    problem.close()


# Parts and folds ----------------------------------------------------------------------------------


def surface_of(
    comm: MPI.Intracomm, size: tuple[float, ...], cells: tuple[int, ...], on: Callable[[Any], Any]
) -> ContactSurface:
    """The exterior facets of a box where ``on`` holds at all their corners."""
    dim = len(size)
    corners = [np.zeros(dim), np.array(size)]
    make = dmesh.create_rectangle if dim == 2 else dmesh.create_box
    mesh = make(comm, corners, list(cells))
    facets = np.sort(dmesh.locate_entities_boundary(mesh, dim - 1, on))
    tags = dmesh.meshtags(mesh, dim - 1, facets, np.full(len(facets), 1, dtype=np.int32))
    regions = dmesh.meshtags(mesh, dim, np.empty(0, np.int32), np.empty(0, np.int32))
    one_part = np.zeros(len(_compat.cell_nodes(mesh)), dtype=np.int32)
    domain = Domain(mesh, regions, tags, one_part, {}, {"contact": (1,)})
    return ContactSurface(domain, fem.functionspace(mesh, ("P", 1, (dim,))), ("contact",))


def kernel_mean(distance: FloatArray, weights: FloatArray, w: FloatArray, r: float) -> FloatArray:
    """R by its formula from all distances (k, k)."""
    inside = np.minimum(distance / r, 1.0 - 1e-15)
    kernel = np.where(distance < r * (1.0 - 1e-12), np.exp(-1.0 / (1.0 - inside**2)), 0.0)
    return np.asarray((kernel @ (weights * w)) / (kernel @ weights))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("comm", [MPI.COMM_WORLD, MPI.COMM_SELF], ids=["together", "alone"])
def test_two_parts_of_gamma_c_that_are_not_joined_do_not_average_over_each_other(
    comm: MPI.Intracomm, dim: int
) -> None:
    def apart(x: Any) -> Any:
        return (x[dim - 1] < 1e-9) & ((x[0] < 0.41) | (x[0] > 0.59))

    surface = surface_of(comm, (1.0,) * dim, (10, 4, 4)[:dim], apart)
    smoothing = ConvolutionOperator(comm, surface.whole(), 0.5)
    left = surface.points[:, 0] < 0.5
    smoothed = smoothing.apply(np.where(left, 1.0, 0.0))
    assert smoothed == pytest.approx(np.where(left, 1.0, 0.0), abs=1e-14)


@pytest.mark.parametrize("comm", [MPI.COMM_WORLD, MPI.COMM_SELF], ids=["together", "alone"])
def test_distances_in_two_dimensions_are_lengths_along_the_curve(comm: MPI.Intracomm) -> None:
    def around_the_end(x: Any) -> Any:
        return (x[1] < 1e-9) | (x[0] > 1.0 - 1e-9) | (x[1] > 0.1 - 1e-9)

    # Bottom, right side and top of a thin strip: stretched out, a line of length 2.1.
    surface = surface_of(comm, (1.0, 0.1), (40, 4), around_the_end)
    x, y = surface.points.T
    place = np.where(y < 1e-9, x, np.where(x > 1.0 - 1e-9, 1.0 + y, 2.1 - x))
    place = np.where((y > 0.1 - 1e-9) & (x > 1.0 - 1e-9), 1.1, place)
    values = np.sin(3.0 * place)
    found = ConvolutionOperator(comm, surface.whole(), 0.3).apply(values)
    s, weights, w, smoothed = gathered(comm, place, surface.weights, values, found)
    expected = kernel_mean(np.abs(s[:, None] - s), weights, w, 0.3)
    assert smoothed == pytest.approx(expected, abs=1e-12)


def pairs_within(whole: SurfaceMesh, radius: float) -> list[Any]:
    """All pairs together; a rank may have none."""
    nothing = np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0)
    return [np.concatenate(parts) for parts in zip(nothing, *whole.within(radius), strict=True)]


@pytest.mark.serial
def test_a_closed_curve_is_measured_the_shorter_way_around() -> None:
    comm = MPI.COMM_WORLD
    surface = surface_of(comm, (1.0, 1.0), (8, 8), lambda x: np.full(x.shape[1], True))
    whole = surface.whole()
    assert len(whole.facets) == len(whole.points) == 32
    rows, columns, distances = pairs_within(whole, 2.0)
    assert distances.max(initial=0.0) <= 2.0
    # On a square of circumference 4 all nodes except the opposite node are nearer than 2.
    assert (np.bincount(rows, minlength=len(surface.nodes)) == 31).all()
    across = np.linalg.norm(whole.points[whole.owned][rows] - whole.points[columns], axis=1)
    assert np.all(distances >= across - 1e-12)


@pytest.mark.serial
def test_a_kernel_that_keeps_constants_beside_a_clamp_is_known() -> None:
    def place(**changes: Any) -> str | None:
        problem = assemble(block(**changes), MPI.COMM_WORLD)
        problem.close()
        return problem.contacts[0].constant_support()

    assert place() == "x = 0, y = 0"
    assert place(friction__smoothing={"kernel": "none"}) is None
    assert place(friction__coefficient=0.0) is None
    assert place(loads__displacements=[{"on": "top", "value": [0.0, -0.01]}]) is None
