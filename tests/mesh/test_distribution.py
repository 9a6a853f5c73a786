"""How a mesh is distributed over the ranks."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI
from problems import block

from contact_locking.mesh.sources import from_geometry


def test_the_same_mesh_is_distributed_in_the_same_way_each_time() -> None:
    parameters = block(2, 1 / 32)
    first, *others = (
        from_geometry(parameters.mesh.geometry, MPI.COMM_WORLD).mesh for _ in range(6)
    )
    for mesh in others:
        owned = mesh.topology.index_map(2).size_local
        assert owned == first.topology.index_map(2).size_local
        assert np.array_equal(mesh.geometry.x, first.geometry.x)
