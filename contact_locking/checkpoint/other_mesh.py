"""The message about a checkpoint of another mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from contact_locking.checkpoint.record import Record


def another_mesh(
    directory: str | Path, difference: str, record: Record, identity: dict[str, Any]
) -> str:
    """The message about a checkpoint of another mesh, with the parameters that differ."""
    names = [name for name in {**record.mesh, **identity} if name not in ("content", "refined")]
    changes = [
        f"mesh.{name} was {record.mesh.get(name)}, is {identity.get(name)}"
        for name in names
        if record.mesh.get(name) != identity.get(name)
    ]
    if record.mesh.get("content") != identity.get("content"):
        changes = ["the mesh file is another one or has changed"]
    if record.mesh.get("refined") != identity.get("refined"):
        changes.append("it was refined; restart with a section adapt, which takes the refined mesh")
    # Another version of Gmsh makes another mesh of the same parameters.
    told = "; ".join(changes) or "perhaps another version of Gmsh; a mesh.file would not change"
    return (
        f"the checkpoint in {directory} is of another mesh: {difference} ({told}); "
        "restart with the mesh of the checkpoint"
    )
