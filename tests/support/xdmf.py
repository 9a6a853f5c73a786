"""XDMF files of the tests: of domains, and of meshes that are no bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np
from dolfinx import io
from dolfinx import mesh as dmesh

from contact_locking.mesh.domain import Domain

MeshElements = Sequence[Sequence[int]]

_KINDS = {2: "PolyLine", 3: "Triangle", 4: "Tetrahedron"}
_AXES = {2: "XY", 3: "XYZ"}


def write_xdmf(
    path: Path,
    points: Sequence[Sequence[float]],
    groups: Mapping[str, MeshElements],
    values: Mapping[str, Sequence[int]] | None = None,
) -> Path:
    """Write a mesh and its groups as `dolfinx.io.XDMFFile` does; simplices name points from 1.

    The simplices of the highest dimension are the cells; those of the group "" have no tags.
    ``values`` are the values of the tags of a group, 1 if there are none.
    """
    width = max(len(rows[0]) for rows in groups.values())
    cells = [row for rows in groups.values() for row in rows if len(row) == width]
    file = h5py.File(path.with_suffix(".h5"), "w")

    def item(place: str, rows: Sequence[Sequence[float]], whole: bool) -> str:
        """The reference to an array, which is written."""
        array = np.array(rows, dtype=np.int64 if whole else float)
        file[place] = array
        size = " ".join(map(str, array.shape))
        kind = ' NumberType="Int"' if whole else ""
        place = f"{path.with_suffix('.h5').name}:{place}"
        return f'<DataItem Dimensions="{size}"{kind} Format="HDF">{place}</DataItem>'

    def topology(place: str, rows: MeshElements) -> str:
        nodes = [[i - 1 for i in row] for row in rows]
        kind = f'TopologyType="{_KINDS[len(rows[0])]}" NumberOfElements="{len(rows)}"'
        data = item(place, nodes, True)
        return f'<Topology {kind} NodesPerElement="{len(rows[0])}">{data}</Topology>'

    grids = [
        f'<Grid Name="mesh" GridType="Uniform">{topology("/Mesh/mesh/topology", cells)}'
        f'<Geometry GeometryType="{_AXES[len(points[0])]}">'
        f"{item('/Mesh/mesh/geometry', points, False)}</Geometry></Grid>"
    ]
    for number, (name, rows) in enumerate(groups.items()):
        if not name:
            continue
        place = f"/MeshTags/{number}"
        own = [[value] for value in (values or {}).get(name, [1] * len(rows))]
        attribute = (
            f'<Attribute Name={quoteattr(name)} AttributeType="Scalar" Center="Cell">'
            f"{item(f'{place}/Values', own, True)}</Attribute></Grid>"
        )
        grids.append(
            f'<Grid Name={quoteattr(name)} GridType="Uniform">'
            f"{topology(f'{place}/topology', rows)}{attribute}"
        )
    file.close()
    text = f'<Xdmf Version="3.0"><Domain>{"".join(grids)}</Domain></Xdmf>'
    path.write_text(f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8")
    return path


def export(domain: Domain, path: Path) -> None:
    """Write the mesh of a domain and its groups as DOLFINx does; collective."""
    mesh, dim = domain.mesh, domain.dim
    mesh.name = "mesh"
    groups = [(dim, name, domain.cells(name)) for name in domain.cell_names]
    groups += [(dim - 1, name, domain.facets((name,))) for name in domain.facet_names]
    with io.XDMFFile(domain.comm, path, "w") as file:
        file.write_mesh(mesh)
        for of, name, entities in groups:
            tags = dmesh.meshtags(mesh, of, entities, np.ones(len(entities), dtype=np.int32))
            tags.name = name
            file.write_meshtags(tags, mesh.geometry)
