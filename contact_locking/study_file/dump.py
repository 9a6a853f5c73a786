"""Parameters as YAML, with every default written out that is not null."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq

from contact_locking.contact.contact import Foundation
from contact_locking.files import file_digest
from contact_locking.mesh.data import data_file, is_xdmf
from contact_locking.results.output import HEADER
from contact_locking.study_file.parameters import Parameters
from contact_locking.study_file.parameters.problem import MeshParameters
from contact_locking.values.concept import ONLY, Concept
from contact_locking.values.value import Value


def dump(parameters: Parameters) -> str:
    """A study file that loads back to equal parameters."""
    yaml = YAML(pure=True)
    # ruamel.yaml changes blanks when it folds long text, and unusual line ends unless escaped.
    yaml.width = 2**20
    yaml.allow_unicode = False
    yaml.representer.add_representer(
        type(None), lambda writer, _: writer.represent_scalar("tag:yaml.org,2002:null", "null")
    )
    stream = io.StringIO()
    stream.write(HEADER)
    yaml.dump(plain(parameters), stream)
    return stream.getvalue()


def plain(value: Any) -> Any:
    """Parameters as nested mappings and lists, with every default."""
    match value:
        case Value():
            return value.data
        case MeshParameters():
            return {key: plain(entry) for key, entry in value.model_dump().items()}
        case Concept():
            fields = type(value).model_fields.items()
            values = {
                value.key_of(name): getattr(value, name)
                for name, field in fields
                if not field.exclude
            }
            if ONLY in values:
                return plain(values[ONLY])
            return {key: plain(entry) for key, entry in values.items() if entry is not None}
        case dict():
            return {key: plain(entry) for key, entry in value.items()}
        case list() | tuple():
            items = CommentedSeq(plain(entry) for entry in value)
            if not any(isinstance(entry, dict) for entry in items):
                items.fa.set_flow_style()
            return items
    return value


# 64 bits: 10 000 cases share one with a probability of 3e-12.
_DIGITS = 16
# The sections that define a solution, beside contact and friction.
_PROBLEM = ("mesh", "discretisation", "material", "loads", "steps", "tables", "penalty")


def fingerprint(parameters: Parameters, digest: Callable[[str], str] = file_digest) -> str:
    """16 hexadecimal digits of the parameters that define the results.

    All parameters count except the title, the study, the fit, and the folder of the results and
    the charts of their report.  A file of a mesh, a tool or a table counts by the ``digest`` of its
    content and not by its path.  Raises OSError if it cannot be read.
    """
    data = parameters.model_dump(by_alias=True, exclude={"title", "study", "fit", "friction"})
    del data["output"]["directory"], data["output"]["charts"]
    return _short(_normalised(data, parameters, digest))


def fit_fingerprint(parameters: Parameters) -> str:
    """16 hexadecimal digits of the parameters that define a fit, its data too.  Raises OSError."""
    assert parameters.fit is not None
    data = parameters.fit.model_dump()
    for curve in data["data"]:
        curve["file"] = file_digest(curve["file"])
    return _short({"study": fingerprint(parameters), "fit": data})


def problem_fingerprint(parameters: Parameters) -> str:
    """16 hexadecimal digits of the parameters that define the solution.  Raises OSError.

    The solver and the output do not count.
    """
    data = parameters.model_dump(by_alias=True, include=set(_PROBLEM))
    return _short(_normalised(data, parameters, file_digest))


def _normalised(
    data: dict[str, Any], parameters: Parameters, digest: Callable[[str], str]
) -> dict[str, Any]:
    """The data in one form, where a study file may write them in several ways."""
    for table in (data.get("tables") or {}).values():
        table["file"] = digest(table["file"])
    # Every part of Gamma_C with its complete law of friction, wherever the file defines it.
    contacts = [
        {
            "on": contact.on,
            "gap": contact.gap.data,
            "foundation": contact.foundation and _foundation(contact.foundation, digest),
            "friction": contact.friction and contact.friction.model_dump(),
        }
        for contact in parameters.contacts
    ]
    return {**data, "contact": contacts, "mesh": mesh_identity(parameters, digest)}


def _foundation(foundation: Foundation, digest: Callable[[str], str]) -> dict[str, Any]:
    data = foundation.model_dump()
    if foundation.file is not None:
        keys = data[foundation.shape_key] if foundation.shape_key == "surface" else {}
        data[foundation.shape_key] = {**keys, "file": digest(foundation.file)}
    if foundation.moved is not None:
        data["motion"] = foundation.moved.model_dump()
    return data


def mesh_identity(
    parameters: Parameters, digest: Callable[[str], str] = file_digest
) -> dict[str, Any]:
    """The parameters of a builder as JSON has them, or the digest of a mesh file.

    Raises OSError if the file cannot be read.
    """
    data: dict[str, Any] = json.loads(json.dumps(parameters.mesh.model_dump()))
    if parameters.mesh.file is None:
        return data
    path = data.pop("file")
    files = [path, str(data_file(Path(path)))] if is_xdmf(path) else [path]
    return {"content": " ".join(map(digest, files)), **data}


def _short(data: Mapping[str, Any]) -> str:
    text = json.dumps(data, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
