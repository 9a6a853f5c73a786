"""Names of keys and quantities as a person writes them: ``friction coefficient μ``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from contact_locking.arrays import AXES

from .quantities import QUANTITIES

_TITLES: Mapping[str, str] = {
    "friction.coefficient": "friction coefficient μ",
    "friction.regularisation": "regularisation δ",
    "friction.smoothing.kernel": "smoothing kernel",
    "friction.smoothing.radius": "smoothing radius r",
    "material.elasticity.poisson": "Poisson's ratio ν",
    "material.elasticity.young": "Young's modulus E",
    "material.locking_limit": "strain limit M",
    "mesh.h": "element size h",
    "mesh.h_contact": "element size at the contact",
    "penalty.epsilon": "compliance ε",
    "penalty.n": "penalty n",
    "solver.method": "solver",
    "dofs": "unknowns",
    "dolfinx": "DOLFINx",
    **{quantity.key: quantity.name for quantity in QUANTITIES},
}
# The names of values of a certificate that are not their keys with blanks, and of the iterations.
_WORDS: Mapping[str, str] = {
    "alpha": "α",
    "c_0": "c_0",
    "c_0_reason": "why c_0 is not known",
    "epsilon": "ε",
    "linear": "linear solves",
    "friction": "friction updates",
}
# Sections whose names say nothing beside that of the key below them.
_UNSAID = ("mesh", "material", "loads", "solver", "certificate", "output", "friction_fixed_point")


def title(key: str) -> str:
    """The name of a dotted key of a study file or of a summary.

    The last number of the key of a vector becomes the name of an axis.
    """
    if key in _TITLES:
        return _TITLES[key]
    above, _, last = key.rpartition(".")
    if above in _TITLES and last.isdecimal() and int(last) < len(AXES):
        return f"{_TITLES[above]}, {AXES[int(last)]}"
    words = [part for part in key.split(".") if part not in _UNSAID] or [key]
    return " ".join(words).replace("_", " ")


def words(name: str) -> str:
    """The name of a value of a certificate, which may be dotted, or of a count of iterations."""
    return _WORDS.get(name) or name.replace(".", ", ").replace("_", " ")


def titles(keys: Sequence[str]) -> list[str]:
    """The names of several keys; whole keys where names would be the same."""
    found = [title(key) for key in keys]
    return found if len(set(found)) == len(found) else list(keys)
