"""The study file: read, overridden from the command line, checked, explained and written again."""

from .dump import dump
from .fingerprint import (
    file_digest,
    fingerprint,
    fit_fingerprint,
    mesh_identity,
    problem_fingerprint,
)
from .load import StudyFile, from_mapping, load, require_parameters
from .schema import schema, schema_text
from .starter import names as demo_names
from .starter import starter

__all__ = [
    "StudyFile",
    "demo_names",
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
    "starter",
]
