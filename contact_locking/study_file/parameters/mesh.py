"""The mesh: a geometry of `contact_locking.meshes` with its parameters, or a file."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import asdict, fields
from functools import cache
from typing import Any, Union, get_args, get_origin, get_type_hints

from pydantic import TypeAdapter, ValidationError, model_serializer, model_validator

from contact_locking.meshes import BUILDERS
from contact_locking.plain_text import nearest

from .base import Fault, FaultsError, Section, entry, refuse_if
from .values import Integer, Number, Switch, Text
from .wording import show, unknown_key, value_message

#: The keys that are no parameters of builders.
_SHARED = ("builder", "file", "axisymmetric")


class MeshParameters(Section):
    """A builder with its own parameters, or a file with named physical groups."""

    builder: Text | None = entry("block", "a geometry by name", optional=True)
    file: Text | None = entry(
        None,
        "a Gmsh or XDMF file, relative to the study file, in place of a builder",
        optional=True,
    )
    axisymmetric: Switch = entry(
        False,
        "the 2D mesh is the half section of a body of revolution, in the coordinates "
        "(r, z) = (x, y) with x >= 0",
    )
    geometry: Any = entry(None, "the builder's parameters", hidden=True)

    @property
    def dim(self) -> int | None:
        """Dimension of the body; None for a mesh file, which is read later."""
        return None if self.geometry is None else self.geometry.dim

    @model_validator(mode="before")
    @classmethod
    def _prepare(cls, data: Any) -> Any:
        data = {} if data is None else data
        if not isinstance(data, dict):
            return data
        own = {key: value for key, value in data.items() if key not in _SHARED}
        revolution = {key: data[key] for key in ("axisymmetric",) if key in data}
        builder, file = data.get("builder"), data.get("file")
        if file is not None:
            refuse_if(
                Fault((key,), "does not go with file; a mesh comes from a builder or from a file")
                for key in (*(["builder"] if builder is not None else []), *own)
            )
            return {"builder": None, "file": file, **revolution}
        if builder is None:
            builder = "block"
        if not isinstance(builder, str) or builder not in BUILDERS:
            guess = nearest(builder, BUILDERS) if isinstance(builder, str) else ""
            known = ", ".join(sorted(BUILDERS))
            message = f"unknown geometry {show(builder)}{guess}; there are {known}"
            refuse_if([Fault(("builder",), message)])
        geometry = _geometry(BUILDERS[builder], own)
        if revolution.get("axisymmetric") is True:
            refuse_if(_section_faults(builder, geometry))
        return {"builder": builder, "geometry": geometry, **revolution}

    @model_serializer
    def _flat(self) -> dict[str, Any]:
        revolution = {"axisymmetric": True} if self.axisymmetric else {}
        if self.file is not None:
            return {"file": self.file, **revolution}
        return {"builder": self.builder, **asdict(self.geometry), **revolution}


def _section_faults(builder: str, geometry: Any) -> Iterator[Fault]:
    """The faults of a builder whose mesh is no half section of a body of revolution."""
    place = ("axisymmetric",)
    if geometry.dim != 2:
        section = "builder: disc with quarter: true" if builder == "ball" else "dim: 2"
        yield Fault(place, f"needs a mesh in two dimensions, the half section; take {section}")
    elif getattr(geometry, "quarter", None) is False:
        yield Fault(
            ("quarter",),
            f"the mesh of an axisymmetric {builder} must lie in x >= 0; set it to true",
        )


def _geometry(builder: type, values: dict[Any, Any]) -> Any:
    """The geometry with these values. Raises FaultsError with the place of each wrong value."""
    types_ = _adapters(builder)
    faults = []
    checked = {}
    for key, value in values.items():
        if key not in types_:
            known = (*_SHARED, *types_)
            faults.append(Fault((key,), unknown_key(str(key), known)))
            continue
        try:
            checked[key] = types_[key].validate_python(value)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            cause = first.get("ctx", {}).get("error")
            message = str(cause) if cause else value_message(first)
            faults.append(Fault((key, *first["loc"]), message))
    refuse_if(faults)
    try:
        return builder(**checked)
    except (ValueError, TypeError) as error:
        # The messages of geometries begin with the name of a parameter and a colon.
        name, _, message = str(error).partition(": ")
        known_name = bool(message) and name in types_
        fault = Fault((name,), message) if known_name else Fault((), str(error))
        raise FaultsError([fault]) from None


@cache
def _adapters(builder: type) -> dict[str, TypeAdapter[Any]]:
    """The checks of each parameter, cached because every case of a study uses them."""
    return {name: TypeAdapter(kind) for name, kind in builder_types(builder).items()}


def builder_types(builder: type) -> dict[str, Any]:
    """Name and type of each parameter, with the types of `values` in place of Python's."""
    hints = get_type_hints(builder)
    return {field.name: _strict(hints[field.name]) for field in fields(builder) if field.init}


def _strict(annotation: Any) -> Any:
    simple = {float: Number, int: Integer, bool: Switch, str: Text}
    if annotation in simple:
        return simple[annotation]
    origin, arguments = get_origin(annotation), tuple(map(_strict, get_args(annotation)))
    if origin in (Union, types.UnionType):
        return Union[arguments]  # noqa: UP007
    if origin in (tuple, list):
        return origin[arguments]
    return annotation
