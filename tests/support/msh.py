"""Mesh files of the tests, in Gmsh's format 2.2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

MeshElements = Sequence[Sequence[int]]


def msh(
    points: Sequence[Sequence[float]],
    groups: Mapping[str, MeshElements],
    numbers: Sequence[int] | None = None,
) -> str:
    """The text of a mesh: points, and the elements of each group by numbers of points from 1.

    Elements are numbered from 1 in the order of the groups.  An empty name is no group.
    ``numbers`` are those of the points in the file, if they are others.
    """
    numbers = numbers or range(1, len(points) + 1)
    # The kinds of Gmsh and their dimensions by the number of nodes.
    kinds = {2: 1, 3: 2, 4: 4, 8: 5} | ({4: 3} if all(len(point) == 2 for point in points) else {})
    space = any(len(elements[0]) == 8 for elements in groups.values())
    kinds |= {4: 3} if space else {}
    dims = {1: 1, 2: 2, 3: 2, 4: 3, 5: 3}
    names: list[str] = []
    lines: list[str] = []
    for group, (name, elements) in enumerate(groups.items(), start=1):
        if name:
            names.append(f'{dims[kinds[len(elements[0])]]} {group} "{name}"')
        for nodes in elements:
            tags = f"{kinds[len(nodes)]} 2 {group if name else 0} {group}"
            lines.append(f"{len(lines) + 1} {tags} {' '.join(str(numbers[i - 1]) for i in nodes)}")
    nodes_text = [
        f"{i} {' '.join(map(repr, (*point, 0.0)[:3]))}"
        for i, point in zip(numbers, points, strict=True)
    ]
    sections = {
        "MeshFormat": ["2.2 0 8"],
        "PhysicalNames": [str(len(names)), *names],
        "Nodes": [str(len(points)), *nodes_text],
        "Elements": [str(len(lines)), *lines],
    }
    return "".join(
        "\n".join([f"${name}", *content, f"$End{name}", ""]) for name, content in sections.items()
    )


def write_msh(
    path: Path, points: Sequence[Sequence[float]], groups: Mapping[str, MeshElements]
) -> Path:
    """Write the mesh to a file."""
    path.write_text(msh(points, groups), encoding="utf-8")
    return path
