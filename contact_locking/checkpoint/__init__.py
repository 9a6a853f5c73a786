"""Solved states on disk, to be read on the same mesh by any number of ranks."""

from contact_locking.checkpoint.record import NAME, locate
from contact_locking.checkpoint.stored import Checkpoint, expect, read, size, unavailable, write

__all__ = ["NAME", "Checkpoint", "expect", "locate", "read", "size", "unavailable", "write"]
