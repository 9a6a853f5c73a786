"""Keys that are unknown or gone, in words, and the texts that tell several values apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from contact_locking.plain_text import nearest
from contact_locking.values.value import entry

#: By the name of a key, or by the whole key where another section has the name; the sentence stands
#: in brackets after "unknown key".
REMOVED_KEYS: dict[str, str] = {
    "bound_meshes": "the error bound is that of the mesh of the study: use a finer mesh",
    "by": "meshes are adapted by the estimate, certificate.errors.mesh; leave the key out",
    "at_supports": "next to supports R always preserves constant pressures, as keep did; leave the "
    "key out",
    "tilt": "a foundation does not turn by itself: give motion a rotation, or use a stiff body "
    "that touches in its place",
    "limits_of": "limits are those of the whole strain eps(u); leave the key out, and add the "
    "expansion to the limit where the body may expand freely",
    "curved": "all cells have straight sides; use a smaller mesh.h where a side is round",
    "animation": "there are no animations: ParaView plays the steps of fields.vtkhdf",
    "formats": "ParaView, PyVista and h5py read fields.vtkhdf; leave the key out",
    "limit_at": "the limit is kept at the vertices of triangles and tetrahedra, hence everywhere, "
    "and at the Gauss points elsewhere; leave the key out",
    "solver.friction": "the friction bound is updated inside the iteration; leave the key out, or "
    "take solver.method: penalty for updates around whole solves, with their contraction factor",
    "starts": "a fit is one search; begin others with other numbers in start",
    "facets": "tags of facets belong into mesh.file itself: write mesh and tags to one file with "
    "dolfinx.io.XDMFFile, or name parts of the boundary by place, mesh.parts",
}

#: By the name of a key and one of its values; the sentence is the whole message.
REMOVED_VALUES: dict[tuple[str, str], str] = {
    ("coefficient", "inf"): "must be finite: take 1e3, with which hardly anything slips",
    ("norm", "largest_principal"): "largest_principal is not a norm of limits; use strain, which "
    "implies it, or direction along the fibres that stretch most",
}

# The symbols of the formulas, which users may take for keys.
_SYMBOLS = {
    "M": "material.locking_limit",
    "E": "material.elasticity.young",
    "nu": "material.elasticity.poisson",
    "mu": "friction.coefficient",
    "f0": "loads.body_force",
    "g": "contact.gap",
    "r": "friction.smoothing.radius",
}
# The names that other programs have for keys and builders, where there is one of the second name.
_OTHER_NAMES = {
    "n": "count",
    "plane": "half_space",
    "element_size": "h",
    "mesh_size": "h",
    "rectangle": "block",
    "box": "block",
}
_NO_PLASTICITY = (
    "plasticity is not modelled: the body is elastic up to its strain limit, "
    "material.locking_limit, and no key bounds its stress"
)
_NO_ADHESION = "adhesion is not modelled: foundations and bodies press alone; leave it out"
_NO_TIES = (
    "tied contact is not modelled: mesh both bodies as one, so that they share the nodes of "
    "their common side, with a region for each"
)
_NO_LARGE_STRAIN = (
    "large strains and rotations are not modelled: strains are linear in the displacement; leave "
    "it out for small ones, and use another program for large ones"
)
# Keys that users look for and that there are not, with what to do instead.
_ABSENT = {
    **REMOVED_KEYS,
    "periodic": "there are no periodic pairs: mirror planes are rollers in loads.displacements",
    "spread": "a force is spread evenly: for a rigid plate see contact.foundation.force",
    **dict.fromkeys(("plasticity", "plastic", "yield_stress", "hardening"), _NO_PLASTICITY),
    **dict.fromkeys(("adhesion", "adhesive", "cohesion", "cohesive"), _NO_ADHESION),
    **dict.fromkeys(("tied", "tie", "glued", "bonded"), _NO_TIES),
    **dict.fromkeys(
        ("large_strain", "finite_strain", "large_deformation", "large_rotation", "nlgeom"),
        _NO_LARGE_STRAIN,
    ),
}


def meant(name: str, known: Sequence[str]) -> str:
    """The hint at what a user may have meant by a name that is none of the known ones."""
    if name in _ABSENT:
        return f" ({_ABSENT[name]})"
    if _OTHER_NAMES.get(name) in known:
        return f" (did you mean '{_OTHER_NAMES[name]}'?)"
    symbol = f" (did you mean '{_SYMBOLS[name]}'?)" if name in _SYMBOLS else ""
    return nearest(name, known) or symbol


def unknown_key(key: str, known: Sequence[str], elsewhere: str = "") -> str:
    """The message for an unknown key, with the nearest known key and all known keys.

    ``elsewhere`` is a hint at a key of another section.
    """
    name, colon, value = key.partition(":")
    if colon and name in known:
        hint = f" (a blank is missing after the colon: '{name}: {value}')"
    elif key.isdecimal():
        hint = " (numbers have a decimal point, not a comma)"
    else:
        hint = meant(key, known) or elsewhere
    return f"unknown key{hint}; known here: {', '.join(known)}"


_MOST_CHARACTERS = 72


def texts_of(values: Sequence[Any], text: Callable[[Any], str] = entry) -> list[str]:
    """A short ``text`` for each value; texts that different values have in common are numbered."""
    distinct = {repr(value): _cut(text(value)) for value in values}
    shared = Counter(distinct.values())
    if len(shared) < len(distinct) and text is not entry:  # as numbers that are rounded
        return texts_of(values)
    numbered = {
        name: f"{words} (value {number})" if shared[words] > 1 else words
        for number, (name, words) in enumerate(distinct.items(), start=1)
    }
    return [numbered[repr(value)] for value in values]


def labels(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """For each row its keys with their values, in one line; all rows have the same keys."""
    columns = [(key, texts_of([row[key] for row in rows])) for key in (rows[0] if rows else ())]
    return [
        ", ".join(f"{key} = {texts[number]}" for key, texts in columns)
        for number in range(len(rows))
    ]


def _cut(text: str) -> str:
    return text if len(text) <= _MOST_CHARACTERS else f"{text[: _MOST_CHARACTERS - 1]}…"
