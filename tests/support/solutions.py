"""A solution that consists of known functions, without a solve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from problems import block

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.fem.spaces import P1
from contact_locking.mesh.sources import from_geometry
from contact_locking.results.contact_points import OPEN, SLIP, STICK, ContactPoints, joined
from contact_locking.results.solution import StudySolution
from contact_locking.view.pictures.gather import gather
from contact_locking.view.pictures.style import Snapshot

DIVISIONS = 4
#: Nothing goes on from a solution that was not solved for.
NO_STATE: Any = None


def displacement(x: FloatArray) -> FloatArray:
    """(d, k): a shear and a stretch, with a value of its own at every vertex."""
    return np.vstack(
        [0.02 * x[-1] + 0.01 * x[0] * x[-1], *(-0.03 * x[i] for i in range(1, len(x)))]
    )


def pressure(x: FloatArray) -> FloatArray:
    """Positive where ``x > 1/2`` on the bottom."""
    return np.where(x[-1] < 1e-12, np.maximum(x[0] - 0.5, 0.0), 0.0)


def state(x: FloatArray) -> FloatArray:
    """Open, stick and slip from left to right."""
    inside = np.where(x[0] < 0.9, STICK, SLIP)
    return np.where((x[-1] < 1e-12) & (x[0] > 0.5), inside, OPEN).astype(float)


def made_up(dim: int = 2, contact: bool = True, **changes: Any) -> StudySolution:
    """On a regular grid of the unit block, locked in its upper half; collective."""
    changes = {"mesh__structured": True, **changes}
    parameters = block(dim, 1.0 / DIVISIONS, contact__on="bottom" if contact else [], **changes)
    domain = from_geometry(parameters.mesh.geometry, MPI.COMM_WORLD)
    mesh = domain.mesh
    scalar = fem.functionspace(mesh, ("P", 1))
    vector = fem.functionspace(mesh, ("P", 1, (dim,)))
    cell = fem.functionspace(mesh, ("DG", 0))
    tensor = fem.functionspace(mesh, ("DG", 0, (dim, dim)))

    def function(space: Any, value: Any) -> fem.Function:
        result = fem.Function(space)
        result.interpolate(lambda x: value(x[:dim]))
        return result

    def traction(x: FloatArray) -> FloatArray:
        return np.vstack([-0.3 * pressure(x), *[0.0 * x[0]] * (dim - 1)])

    def stress(x: FloatArray) -> FloatArray:
        return np.vstack([(i + 1) * (1.0 + x[0]) for i in range(dim * dim)])

    points, facets = joined([(_points(dim), _facets(dim))] if contact else [], dim)
    return StudySolution(
        parameters=parameters,
        domain=domain,
        element=P1,
        displacement=function(vector, displacement),
        strain_norm=function(cell, lambda x: 0.02 * np.minimum(2.0 * x[-1], 1.0)),
        locking_limit=function(cell, lambda x: 0.02 + 0.0 * x[0]),
        locked=function(cell, lambda x: (x[-1] > 0.5).astype(float)),
        elastic_stress=function(tensor, stress),
        locking_stress=function(tensor, lambda x: -stress(x)),
        von_mises=function(cell, lambda x: 1.0 + x[0]),
        locking_parts=(),
        error_indicator=function(cell, lambda x: 1e-3 * x[0]),
        elastic_error_indicator=function(cell, lambda x: 1e-3 * x[0]),
        contact_pressure=function(scalar, pressure),
        smoothed_stress=function(scalar, lambda x: -pressure(x)),
        tangential_traction=function(vector, traction),
        contact_state=function(scalar, state),
        friction_bound=function(scalar, lambda x: 0.3 * pressure(x)),
        contacts=_nodal(points),
        contact_points=points if mesh.comm.rank == 0 else None,
        contact_facets=facets if mesh.comm.rank == 0 else None,
        state=NO_STATE,
        reason="every criterion held",
        facts={
            "units": {"length": "mm", "stress": "MPa"},
            "dofs": 1234,
            "locked_fraction": 0.5,
            "contact_force": [0.0, np.float64(0.125)],
            "contacts": [{"name": "bottom"}] if contact else [],
            "certificate": {"bounds": {"one": {"value": 1.0, "bound": np.inf, "holds": True}}},
        },
    )


def of_kind(dim: int, kind: str, **changes: Any) -> StudySolution:
    """A solution of one of the ``KINDS``, with changes of its parameters; collective."""
    solution = made_up(dim, contact=kind != "without contact", **changes)
    change = KINDS[kind]
    return solution if change is None else change(solution)


def snapshot(dim: int = 3, kind: str = "locked") -> Snapshot:
    """What is drawn of a solution of one of the ``KINDS``; for one rank."""
    body = gather(of_kind(dim, kind))
    assert body is not None
    return body


def _unlocked(solution: StudySolution) -> StudySolution:
    solution.locking_limit.x.array[:] = np.inf
    solution.locked.x.array[:] = 0.0
    return solution


def _partly_unlimited(solution: StudySolution) -> StudySolution:
    solution.locking_limit.x.array[::2] = np.inf
    return solution


def _at_rest(solution: StudySolution) -> StudySolution:
    _unlocked(solution)
    for name in ("displacement", "strain_norm", "contact_pressure", "contact_state"):
        getattr(solution, name).x.array[:] = 0.0
    points = solution.contact_points
    if points is not None:
        for values in (points.u_tangent, points.pressure, points.bound, points.traction):
            values[:] = 0.0
        points.state[:] = 0
    return solution


def _not_converged(solution: StudySolution) -> StudySolution:
    return solution.with_entries(converged=False)


def _with_an_odd_title(solution: StudySolution) -> StudySolution:
    object.__setattr__(solution.parameters, "title", r"costs $5 \frac{ and 100 %")
    return solution


def _with_two_contacts(solution: StudySolution) -> StudySolution:
    """On the bottom and, with the two axes swapped, on the left; both have the corner's nodes."""
    dim = solution.domain.dim
    points, facets = _points(dim), _facets(dim)
    force = {"contact_force": [0.0] * dim, "friction_force": [0.0] * dim, "penetration_max": 1e-9}
    areas = {"contact_area": 0.375, "slip_area": 0.0625}
    entries = [
        {"name": "bottom", "on": ["bottom"], **force, **areas},
        {"name": "left, a $part$", "on": ["left", "a $part$"], **force, **areas},
    ]
    swapped = [dim - 1, *range(1, dim - 1), 0]
    turned = {name: getattr(points, name)[:, swapped] for name in ("x", "normal", "u_tangent")}
    left = replace(points, **turned, traction=points.traction[:, swapped])
    both = joined([(points, facets), (left, facets)], dim)
    changed = replace(solution, contacts=_nodal(both[0])).with_entries(contacts=entries)
    if solution.contact_points is None:
        return changed
    return replace(changed, contact_points=both[0], contact_facets=both[1])


KINDS: dict[str, Callable[[StudySolution], StudySolution] | None] = {
    "locked": None,
    "without contact": None,
    "unlocked": _unlocked,
    "partly unlimited": _partly_unlimited,
    "at rest": _at_rest,
    "not converged": _not_converged,
    "with an odd title": _with_an_odd_title,
    "with two contacts": _with_two_contacts,
}


def _nodal(points: ContactPoints) -> Any:
    """The nodal fields of each contact that pictures use, all on rank 0."""
    own = slice(None if MPI.COMM_WORLD.rank == 0 else 0)
    return tuple(
        SimpleNamespace(
            surface=SimpleNamespace(points=part.x[own], is_paired=False),
            smoothed_stress=-part.pressure[own],
            tool=None,
            travel=0.0,
        )
        for part in points.parts()
    )


def _facets(dim: int) -> IntArray:
    """The facets of a regular grid of points: segments, or the halves of the squares."""
    line = np.arange(DIVISIONS)
    if dim == 2:
        return np.column_stack([line, line + 1])
    corner = (line[:, None] * (DIVISIONS + 1) + line).ravel()
    right, above = corner + DIVISIONS + 1, corner + 1
    lower = np.column_stack([corner, above, right])
    return np.concatenate([lower, np.column_stack([above, right, right + 1])])


def _points(dim: int) -> ContactPoints:
    line = np.linspace(0.0, 1.0, DIVISIONS + 1)
    x = np.stack(np.meshgrid(*[line] * (dim - 1), [0.0], indexing="ij"), axis=-1).reshape(-1, dim)
    down = -np.eye(dim)[-1]
    u = displacement(x.T).T
    p = pressure(x.T)
    return ContactPoints(
        x=x,
        normal=np.tile(down, (len(x), 1)),
        u_normal=u @ down,
        u_tangent=u - (u @ down)[:, None] * down,
        gap=np.zeros(len(x)),
        pressure=p,
        traction=-0.3 * p[:, None] * np.eye(dim)[0],
        bound=0.3 * p,
        state=state(x.T).astype(np.int64),
        contact=np.zeros(len(x), dtype=np.int64),
    )
