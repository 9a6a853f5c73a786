"""The block whose solution checkpoints hold, and work that one rank does for all."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from mpi4py import MPI
from problems import block

from contact_locking.study_file.parameters import Parameters

COARSE = {2: 0.2, 3: 0.34}
PLAIN = {"fields": False, "picture": False}


def parameters(dim: int = 2, **changes: Any) -> Parameters:
    given = {"friction__smoothing__radius": 0.4, "output": PLAIN, **changes}
    return block(dim, given.pop("h", COARSE[dim]), **given)


def on_rank_0(comm: MPI.Intracomm, work: Callable[[], object]) -> None:
    if comm.rank == 0:
        work()
    comm.Barrier()
