"""Solved states in files, which any number of ranks can read on the same mesh."""

from contact_locking.process.checkpoint.record import NAME, locate
from contact_locking.process.checkpoint.stored import (
    Checkpoint,
    expect,
    has_cells_everywhere,
    read,
    refined_mesh,
    size,
    unavailable,
    write,
)

__all__ = [
    "NAME",
    "Checkpoint",
    "expect",
    "has_cells_everywhere",
    "locate",
    "read",
    "refined_mesh",
    "size",
    "unavailable",
    "write",
]
