"""Keys and values that earlier versions had, with what to do instead."""

from __future__ import annotations

#: By the name of a key, or by the whole key where another section has the name; the sentence stands
#: in brackets after "unknown key".
KEYS: dict[str, str] = {
    "bound_meshes": "the error bound is that of the mesh of the study: take a finer mesh",
    "by": "meshes are adapted by the estimate, certificate.errors.mesh; leave the key out",
    "at_supports": "beside supports R keeps constant pressures, as by keep; leave the key out",
    "tilt": "a foundation does not turn by itself: give motion a rotation, or take a stiff body "
    "that touches in its place",
    "limits_of": "limits are those of the whole strain eps(u); leave the key out, and add the "
    "expansion to the limit where the body may expand freely",
    "curved": "all cells have straight sides; take a smaller mesh.h where a side is round",
    "animation": "there are no animations: ParaView plays the steps of fields.bp",
    "limit_at": "the limit is kept at the vertices of triangles and tetrahedra, hence everywhere, "
    "and at the Gauss points elsewhere; leave the key out",
    "solver.friction": "the friction bound is updated inside the iteration; leave the key out, or "
    "take solver.method: penalty for updates around whole solves, with their contraction factor",
    "skin": "name the boundary of a cavity by a box, a plane or an expression",
    "facets": "tags of facets stand in mesh.file itself: write mesh and tags to one file with "
    "dolfinx.io.XDMFFile, or name parts of the boundary by place, mesh.parts",
}

#: By the name of a key and one of its values; the sentence is the whole message.
VALUES: dict[tuple[str, str], str] = {
    ("coefficient", "inf"): "must be finite: take 1e3, with which hardly anything slips",
    ("norm", "largest_principal"): "largest_principal is no norm of limits; take strain, which "
    "implies it, or direction along the fibres that stretch most",
}
