"""The features of the family of pairs: their values, and which values exclude each other."""

from __future__ import annotations

from functools import cache

from .covering import Item, Row, design

FEATURES: dict[str, tuple[str, ...]] = {
    "kind": ("plane_strain", "plane_stress", "axisymmetric", "space"),
    "element": ("linear", "quadratic"),
    "body": ("block", "round", "ring", "l_shape", "inclusion", "punch"),
    "foundation": ("gap", "profile", "plane", "ball", "cylinder", "expression", "polyline"),
    "contacts": ("one", "wall", "overlap"),
    "motion": ("none", "lowered", "dragged", "rotating", "cyclic", "pushed"),
    "time": ("static", "steps", "uneven"),
    "support": ("clamp", "moved", "rollers", "oblique", "normal", "friction"),
    "load": ("traction", "varying", "pressure", "body_force", "none", "huge", "tiny"),
    "limit": (
        "none",
        "ball",
        "tight",
        "graded",
        "deviator",
        "volume",
        "direction",
        "weighted",
        "several",
    ),
    "friction": ("zero", "small", "large", "place", "slip"),
    "smoothing": ("convolution", "helmholtz", "none"),
    "penalty": ("exact", "finite", "soft", "smooth"),
    "units": ("one", "pascal", "mm", "rubber"),
    "linear": ("direct", "iterative"),
    "material": ("isotropic", "incompressible", "graded", "lame", "matrix"),
}

# Supports that leave the body free to come nearer to its foundation.
LOOSE = ("rollers", "oblique", "normal", "friction")

# A value, and the values of another feature that it does not go with, by (feature, value).
_EXCLUDED: dict[Item, dict[str, tuple[str, ...]]] = {
    # The limits would be those of a strain, and the matrix that of a law, that are not known.
    ("kind", "plane_stress"): {
        "limit": ("deviator", "volume", "several"),
        "material": ("matrix",),
    },
    # What is no body of revolution, or would move the axis.
    ("kind", "axisymmetric"): {
        "body": ("ring",),
        "foundation": ("cylinder",),
        "motion": ("dragged", "rotating"),
        "support": ("oblique",),
        "contacts": ("wall",),
    },
    ("kind", "space"): {"body": ("ring",), "foundation": ("polyline",)},
    # A round body has no side for a wall, rolls away, and the normals of a circle hold it wholly.
    ("body", "round"): {"contacts": ("wall",), "support": ("friction",)},
    ("body", "ring"): {"contacts": ("wall",), "support": ("friction", "normal")},
    # A gap has neither a place nor a force; a gap that depends on the time needs steps.
    ("foundation", "gap"): {"motion": ("dragged", "rotating", "pushed")},
    ("foundation", "profile"): {"motion": ("dragged", "rotating", "pushed")},
    ("motion", "cyclic"): {"time": ("static",), "support": ("friction",)},
    # Body and tool would move together.
    ("motion", "pushed"): {"support": LOOSE},
    ("motion", "dragged"): {"support": ("friction",)},
    ("motion", "rotating"): {"support": ("friction",)},
    # A body that nothing else holds needs friction, and a foundation on which it does not roll.
    ("support", "friction"): {
        "friction": ("zero",),
        "foundation": ("ball", "cylinder", "profile", "expression"),
    },
}


def agree(one: Item, other: Item) -> bool:
    """Whether two values of different features go together."""
    return all(
        b[1] not in _EXCLUDED.get(a, {}).get(b[0], ()) for a, b in ((one, other), (other, one))
    )


@cache
def rows() -> tuple[Row, ...]:
    """The design, the same on every machine."""
    return tuple(design(FEATURES, agree)[0])
