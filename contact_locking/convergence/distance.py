"""How far two solutions are from each other, on one mesh or on two."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from contact_locking import _compat
from contact_locking.convex import squared_norm
from contact_locking.domain import Domain
from contact_locking.material import strain
from contact_locking.results.derived import integral
from contact_locking.solution import Solution

# Nodes this far outside the other mesh, relative to the body, are taken for rounding.
_PADDING = 1e-8


@dataclass(frozen=True)
class Norms:
    """``v``: ``|w|_V = |eps(w)|`` in L2 (10); ``l2``, ``contact``: w in L2 of the body, Gamma_C."""

    v: float
    l2: float
    contact: float

    def over(self, other: Norms) -> Norms:
        """Each norm relative to the other's, and itself where that is 0."""
        mine, theirs = dataclasses.astuple(self), dataclasses.astuple(other)
        return Norms(*(a / b if b > 0.0 else a for a, b in zip(mine, theirs, strict=True)))


def norms(w: fem.Function, domain: Domain, contact: tuple[str, ...] = ()) -> Norms:
    """The norms of a displacement; ``contact`` names the parts of Gamma_C.  Collective."""
    dx = ufl.Measure("dx", domain=domain.mesh)
    squares = [integral(domain, squared_norm(f) * dx) for f in (strain(w), w)]
    squares.append(integral(domain, squared_norm(w) * domain.ds(contact)) if contact else 0.0)
    return Norms(*(math.sqrt(square) for square in squares))


def distance(solution: Solution, reference: Solution) -> Norms:
    """The norms of ``u - u_ref``, integrated on the reference's mesh; collective.

    u is interpolated there, which is exact where its mesh is a coarser one of nested meshes, as
    structured blocks are whose numbers of cells divide each other.  Raises ValueError if the
    reference's mesh reaches beyond the other.
    """
    difference = fem.Function(reference.displacement.function_space)
    difference.interpolate(on_mesh_of(solution.displacement, reference.displacement))
    difference.x.array[:] -= reference.displacement.x.array
    return norms(difference, reference.domain, reference.parameters.contact_names)


def on_mesh_of(u: fem.Function, other: fem.Function) -> fem.Function:
    """``u`` interpolated into the space of ``other``, wherever its cells are; collective.

    Raises ValueError if a node lies in no cell of u's mesh.
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
    local = float(np.abs(x).max(initial=0.0))
    padding = _PADDING * source.mesh.comm.allreduce(local, op=MPI.MAX)
    owners = fem.create_interpolation_data(space, source, everywhere, padding=padding)
    missing = bool(np.any(_compat.point_owners(owners) < 0))
    if mesh.comm.allreduce(missing, op=MPI.LOR):
        raise ValueError("the mesh of the reference reaches beyond that of the solution")
    found.interpolate_nonmatching(u, everywhere, owners)
    found.x.scatter_forward()
    return found
