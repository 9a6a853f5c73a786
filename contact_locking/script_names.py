"""The names that a script has for the keys of a study file, in messages of both."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from typing import Any

from contact_locking.errors import InputError

# Longer keys come before their beginnings.
_NAMES = {
    "(solver.petsc, or after --)": "(settings.petsc)",
    "solver.": "settings.",
    "penalty.n": "n",
    "penalty.epsilon": "compliance",
    "friction.coefficient": "Coulomb.coefficient",
    "friction.regularisation": "Coulomb.regularisation",
    "friction.smoothing.": "Convolution.",
    "loads.displacements": "bcs",
    "loads.supports": "bcs",
    "material.locking_limit": "StrainBall.limit",
    "material.locking": "limits",
    "material.elasticity.": "Elasticity.",
    "mesh.h_contact or mesh.h": "smaller cells",
    "mesh.cells: simplex": "triangles or tetrahedra",
    "mesh.h_contact": "smaller cells there",
    "mesh.h": "smaller cells",
    "mesh.axisymmetric": "axisymmetric",
    "discretisation.degree": "the degree of space",
    "certificate.": "extras.",
    ".inf": "math.inf",
}
_KEYS = re.compile("|".join(rf"(?<![\w.]){re.escape(key)}" for key in _NAMES))
# A value that a message advises, as YAML writes it after a key.
_NUMBER = re.compile(r"(?<=\w): (?=[-+]?\.?\d|math\.inf)")
_WORD = re.compile(r"(settings\.\w+|Convolution\.\w+): ([a-z_]+)(?=[ ,;).]|$)")


def in_script(value: Any) -> Any:
    """A message, or nested lists and mappings of values, with the names of a script."""
    match value:
        case dict():
            return {key: in_script(item) for key, item in value.items()}
        case list():
            return [in_script(item) for item in value]
        case str():
            named, count = _KEYS.subn(lambda found: _NAMES[found[0]], value)
            return _WORD.sub(r'\1="\2"', _NUMBER.sub("=", named)) if count else value
    return value


@contextlib.contextmanager
def script_names() -> Iterator[None]:
    """Raise each InputError with the names of a script."""
    try:
        yield
    except InputError as error:
        message, key = in_script(str(error)), in_script(error.key)
        if (message, key) == (str(error), error.key):
            raise
        raise type(error)(message, key) from error
