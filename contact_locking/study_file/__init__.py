"""The study file: read, overridden from the command line, checked, explained and written again."""

from .dump import dump
from .fingerprint import file_digest, fingerprint, mesh_identity, problem_fingerprint
from .load import StudyFile, from_mapping, load
from .schema import schema, schema_text

__all__ = [
    "StudyFile",
    "dump",
    "file_digest",
    "fingerprint",
    "from_mapping",
    "load",
    "mesh_identity",
    "problem_fingerprint",
    "schema",
    "schema_text",
]
