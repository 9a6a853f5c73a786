"""The study file: read, overridden from the command line, checked, explained and written again."""

from .dump import dump
from .fingerprint import (
    file_digest,
    fingerprint,
    fit_fingerprint,
    mesh_identity,
    problem_fingerprint,
)
from .reading import StudyFile, from_mapping, load, require_parameters
from .schema import schema, schema_text

__all__ = [
    "StudyFile",
    "dump",
    "file_digest",
    "fingerprint",
    "fit_fingerprint",
    "from_mapping",
    "load",
    "mesh_identity",
    "problem_fingerprint",
    "require_parameters",
    "schema",
    "schema_text",
]
