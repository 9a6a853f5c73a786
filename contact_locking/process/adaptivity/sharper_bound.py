"""A sharper guaranteed bound of a solution, by a displacement on finer meshes.

For the displacement u_h on the mesh of a study and a solution w of the inequality on a mesh that
refines this mesh,

    |u - u_h|_a <= |u - w|_a + |w - u_h|_a,

where u has the friction bound of w, in `errors.guaranteed`, or one that moves, in
`errors.moving_friction`.  The bound of the first part falls where the cells are refined that it
comes from, and the second part is known.  u_h need not be admissible.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking import _compat
from contact_locking.arrays import BoolArray
from contact_locking.errors import NotRefined
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.file.data import MeshData
from contact_locking.mesh.whole_mesh import gather_cells
from contact_locking.monitor import Monitor
from contact_locking.parallel import maximum, on_any_rank
from contact_locking.problem.distance import distance
from contact_locking.process.adaptivity.marking import marked_cells
from contact_locking.process.adaptivity.mesh_sequence import MEASURES
from contact_locking.process.adaptivity.refinement import finer_mesh
from contact_locking.process.solving import solve_assembled
from contact_locking.results.solution import StudySolution
from contact_locking.study.assembly import assemble
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.numerics import CertificateParameters

# The share of the squared bound that the marked cells have.  Fewer meshes reach the same bound
# than with a smaller share.
_SHARE = 0.7
# A node may lie outside the other mesh by this share of the body because of rounding.
_PADDING = 1e-8
# No mesh has more unknowns.
_MOST = 100_000
_PROVED = (
    "proved for the friction bound of the solution for n = .inf on {cells} cells, kept fixed, on "
    "the polygon of the mesh, with the material of these cells, constant in each; up to rounding "
    "and the tolerance of the solver"
)


def sharper_errors(
    solution: StudySolution, monitor: Monitor, petsc_options: Mapping[str, Any] | None
) -> dict[str, Any]:
    """The errors of the summary with the least ``|u - w|_a + |w - u_h|_a``; collective.

    There are `certificate.bound_meshes` finer meshes, and before them the mesh itself where u_h is
    no solution of the inequality that keeps its limits everywhere.  Meshes end earlier where a
    solve fails, where the bound is not applicable, or at 100 000 unknowns.  An entry differs
    only if it becomes less, or a proof in place of an estimate.
    """
    given, errors = solution.parameters, {**solution.summary["certificate"]["errors"]}
    assert given.certificate.bound_meshes is not None
    exact = _inequality(given)
    is_exact = (given.penalty, given.discretisation) == (exact.penalty, exact.discretisation)
    w: StudySolution | None = solution
    for number in range(0 if is_exact else -1, given.certificate.bound_meshes):
        assert w is not None
        domain = w.domain if number < 0 else _finer(w)
        if domain is None:
            break
        monitor.message(f"solving for n = .inf on {domain.num_cells} cells, for a sharper bound")
        problem = assemble(exact, domain.comm, domain)
        w = solve_assembled(problem, monitor, petsc_options)
        found = w.summary["certificate"]["errors"]
        if not (w.converged and found["guaranteed"]["applicable"]):
            break
        u = on_mesh_of(solution.displacement, w.displacement)
        apart = distance(u, w.displacement, problem.data)
        for name in ("guaranteed", "moving_friction"):
            new, old = found.get(name), errors.get(name)
            if old is None or new is None or new["energy_norm"] is None:
                continue
            total = new["energy_norm"] + apart["energy_norm"]
            if _rank(new | {"energy_norm": total}) < _rank(old):
                size = apart["energy_norm"] / apart["relative"] if apart["relative"] else None
                errors[name] = new | {
                    "energy_norm": total,
                    "relative": None if size is None else total / size,
                    "finer_cells": domain.num_cells,
                }
                if name == "guaranteed":
                    errors[name]["reason"] = _PROVED.format(cells=domain.num_cells)
    return errors


def on_mesh_of(u: fem.Function, other: fem.Function) -> fem.Function:
    """``u`` interpolated into the space of ``other``, on the same or another mesh; collective.

    Raises ValueError if a node of ``other`` lies in no cell of the mesh of u.
    """
    space, source = other.function_space, u.function_space
    found = fem.Function(space)
    if source.mesh is space.mesh:
        found.interpolate(u)
        return found
    mesh = space.mesh
    cells = mesh.topology.index_map(mesh.topology.dim)
    everywhere = np.arange(cells.size_local + cells.num_ghosts, dtype=np.int32)
    x = source.mesh.geometry.x
    padding = _PADDING * maximum(source.mesh.comm, np.abs(x))
    owners = fem.create_interpolation_data(space, source, everywhere, padding=padding)
    if on_any_rank(mesh.comm, _compat.point_owners(owners) < 0):
        raise ValueError("the mesh of the reference reaches beyond the mesh of the solution")
    found.interpolate_nonmatching(u, everywhere, owners)
    found.x.scatter_forward()
    return found


def _rank(entry: Mapping[str, Any]) -> tuple[bool, float]:
    """The less, the better: an estimate comes after every proof."""
    size = entry["energy_norm"]
    return (True, math.inf) if size is None else (bool(entry.get("estimated")), size)


def _inequality(given: Parameters) -> Parameters:
    """The inequality with limits at all points of the strain, and with the bound alone."""
    alone = CertificateParameters(error_bound=True)
    changed: dict[str, Any] = {"certificate": alone, "sensitivities": None}
    if given.discretisation.degree == 2:
        limited = given.discretisation.model_copy(update={"limit_at": "vertices"})
        changed["discretisation"] = limited
    return given.limit().model_copy(update=changed)


def _finer(solution: StudySolution) -> Domain | None:
    """The mesh refined where the bound comes from; None if there is none; collective."""
    squares = MEASURES["bound"].squares(solution)
    if squares is None:
        return None
    every = gather_cells(solution.domain, squares)

    def marks(data: MeshData) -> BoolArray:
        assert every is not None
        return marked_cells(every, _SHARE)

    try:
        return finer_mesh(solution, marks, _MOST, f"{_MOST}", is_nested=True)
    except NotRefined:
        return None
