"""A short name for what a run computes: equal for equal results, whatever the file looks like."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path

from contact_locking.parameters import Parameters

# 64 bits: 10 000 cases share one with a probability of 3e-12.
_DIGITS = 16


def file_digest(path: str) -> str:
    """The SHA-256 of a file's content. Raises OSError."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fingerprint(parameters: Parameters, digest: Callable[[str], str] = file_digest) -> str:
    """16 hexadecimal digits of the parameters that matter to the results.

    Those are all but the title, the study around a case and the folder of the results.  A mesh
    file counts with its content, by ``digest``, and not with its place.  Raises OSError if it
    cannot be read.
    """
    data = parameters.model_dump(by_alias=True, exclude={"title": True, "study": True})
    del data["output"]["directory"]
    if parameters.mesh.file is not None:
        data["mesh"] = {"content": digest(parameters.mesh.file)}
    text = json.dumps(data, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
