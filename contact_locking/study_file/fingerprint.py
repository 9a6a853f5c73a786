"""Fingerprints of parameters: equal for study files that define equal results."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from contact_locking.mesh_file.xdmf_grids import data_file, is_xdmf
from contact_locking.parameters import Foundation, Parameters
from contact_locking.parameters.base import Section

# 64 bits: 10 000 cases share one with a probability of 3e-12.
_DIGITS = 16
# The keys of a foundation that there were not at first.
_LATER = ("expression", "polyline", "surface", "motion", "force")
# The sections that define a solution, beside contact and friction.
_PROBLEM = ("mesh", "discretisation", "material", "loads", "steps", "tables", "penalty")


def file_digest(path: str) -> str:
    """The SHA-256 of a file's content. Raises OSError."""
    with Path(path).open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fingerprint(parameters: Parameters, digest: Callable[[str], str] = file_digest) -> str:
    """16 hexadecimal digits of the parameters that define the results.

    All parameters count except the title, the study and the folder of the results.  A file of a
    mesh, a tool or a table counts by the ``digest`` of its content and not by its path.  Raises
    OSError if it cannot be read.
    """
    data = parameters.model_dump(by_alias=True, exclude={"title", "study", "contact", "friction"})
    del data["output"]["directory"]
    if not parameters.output.probes:
        # A run without probes keeps the fingerprint that it had before.
        del data["output"]["probes"]
    if parameters.output.animation:
        # The default keeps the fingerprint that there was before animations.
        del data["output"]["animation"]
    if parameters.adapt is None:
        # One mesh keeps the fingerprint that it had before there were adapted meshes.
        del data["adapt"]
    return _short(_normalised(data, parameters, digest))


def problem_fingerprint(parameters: Parameters) -> str:
    """16 hexadecimal digits of the parameters that define the solution.  Raises OSError.

    The solver and the output do not count.
    """
    data = parameters.model_dump(by_alias=True, include=set(_PROBLEM))
    return _short(_normalised(data, parameters, file_digest))


def _normalised(
    data: dict[str, Any], parameters: Parameters, digest: Callable[[str], str]
) -> dict[str, Any]:
    """The data with one form for what a study file may write in several ways."""
    if parameters.discretisation.degree == 1:
        # There the limit is the same at vertices and at Gauss points.
        del data["discretisation"]
    for section in (data["material"], *data["material"]["regions"].values()):
        if not section["locking"]:
            # A body with the ball alone keeps the fingerprint that it had before.
            del section["locking"]
    if parameters.material.plane == "strain":
        # A body in plane strain keeps the fingerprint that it had before.
        del data["material"]["plane"]
    if not parameters.loads.pressures:
        # A body without pressures or supports keeps the fingerprint that it had before.
        del data["loads"]["pressures"]
    if not parameters.loads.supports:
        del data["loads"]["supports"]
    if not parameters.tables:
        # A problem without tables keeps the fingerprint that it had before.
        del data["tables"]
    for table in data.get("tables", {}).values():
        table["file"] = digest(table["file"])
    if parameters.steps is None:
        # One static load keeps the fingerprint that it had before there were steps.
        del data["steps"]
    return {**data, **_contact(parameters, digest), "mesh": mesh_identity(parameters, digest)}


def _contact(parameters: Parameters, digest: Callable[[str], str]) -> dict[str, Any]:
    """Every part of Gamma_C with its complete law of friction, wherever the file defines it."""
    if isinstance(parameters.contact, tuple):
        contacts = parameters.contacts
    else:
        contacts = (parameters.contact.resolved("contact", parameters.friction),)
    parts: list[dict[str, Any]] = [
        {
            "contact": {
                "on": part.on,
                "gap": part.gap,
                "foundation": part.foundation and _foundation(part.foundation, digest),
            },
            "friction": part.friction.model_dump(),
        }
        for part in contacts
    ]
    return parts[0] if len(parts) == 1 else {"contacts": parts}


def _foundation(given: Foundation, digest: Callable[[str], str]) -> dict[str, Any]:
    data = given.model_dump()
    for name in _LATER:
        if data[name] is None:
            # A study without the key keeps the fingerprint that it had before there was one.
            del data[name]
    shape, value = given.shape
    if given.file is not None:
        more = value.model_dump(exclude={"file"}) if isinstance(value, Section) else {}
        data[shape] = {"content": digest(given.file), **more}
    if given.moved is not None:
        data["motion"] = given.moved.model_dump()
    return data


def mesh_identity(
    parameters: Parameters, digest: Callable[[str], str] = file_digest
) -> dict[str, Any]:
    """The parameters of a builder as JSON has them, or the digest of a mesh file.

    Raises OSError if the file cannot be read.
    """
    if parameters.mesh.file is not None:
        revolution = {"axisymmetric": True} if parameters.mesh.axisymmetric else {}
        return {"content": _mesh_digest(parameters.mesh.file, digest), **revolution}
    return dict(json.loads(json.dumps(parameters.mesh.model_dump())))


def _mesh_digest(path: str, digest: Callable[[str], str]) -> str:
    """The digest of a mesh file, with that of the data of an XDMF file."""
    if not is_xdmf(path):
        return digest(path)
    return f"{digest(path)} {digest(str(data_file(Path(path))))}"


def _short(data: Mapping[str, Any]) -> str:
    text = json.dumps(data, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
