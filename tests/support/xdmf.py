"""XDMF files of the tests, also of meshes that are no bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from petsc4py import PETSc

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
    viewer = PETSc.ViewerHDF5().create(str(path.with_suffix(".h5")), "w", comm=PETSc.COMM_SELF)

    def item(place: str, rows: Sequence[Sequence[float]], whole: bool) -> str:
        """The reference to an array, which is written."""
        folder, _, name = place.rpartition("/")
        array = np.array(rows, dtype=PETSc.IntType if whole else float)
        viewer.pushGroup(folder)
        made: PETSc.Object
        if whole:
            made = PETSc.IS().createGeneral(array.reshape(-1), comm=PETSc.COMM_SELF)
            made.setBlockSize(array.shape[1])
        else:
            made = PETSc.Vec().createWithArray(
                array.reshape(-1), comm=PETSc.COMM_SELF, bsize=array.shape[1]
            )
        made.setName(name)
        made.view(viewer)
        made.destroy()
        viewer.popGroup()
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
    viewer.destroy()
    text = f'<Xdmf Version="3.0"><Domain>{"".join(grids)}</Domain></Xdmf>'
    path.write_text(f'<?xml version="1.0"?>\n{text}\n', encoding="utf-8")
    return path
