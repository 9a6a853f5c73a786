"""The sections that state the problem: the mesh, the material, also by region, and the loads.

The mesh is a geometry of `contact_locking.meshes` with its parameters, or a file.
"""

from __future__ import annotations

import math
import types
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, fields
from functools import cache
from keyword import iskeyword
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import Field, TypeAdapter, ValidationError, model_serializer

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.expressions import CONSTANTS, FUNCTIONS, POSITION, TIME, parse
from contact_locking.laws.limits import StrainBall, StrainLimit, StrainLimits
from contact_locking.laws.material import Eigenstrain, Eigenstrains, Elasticity
from contact_locking.meshes import BUILDERS
from contact_locking.study_file.parameters.wording import meant, unknown_key
from contact_locking.supports.support import (
    BodyForce,
    Displacement,
    Load,
    Pressure,
    Spring,
    Support,
    TotalForce,
    Traction,
)
from contact_locking.values.concept import (
    PER_AXIS,
    BodyKind,
    Concept,
    Fault,
    FaultsError,
    Place,
    dotted,
    entry,
    leaves,
    place_of,
    refuse_if,
)
from contact_locking.values.kinds import (
    Condition,
    Direction,
    File,
    Integer,
    Names,
    Number,
    NumberOrInfinite,
    Point,
    PositiveScalarOrInfinite,
    Switch,
    Text,
    TimedVector,
)
from contact_locking.values.value import Value, show, value_message

#: The keys that are no parameters of builders.
_SHARED = ("builder", "file", "axisymmetric", "parts")


class Plane(Concept):
    """(x - point) . normal = 0."""

    point: Point = entry(..., "a point of the plane", "length")
    normal: Direction = entry(..., "normal of the plane, of any length", "1")


_Corner = Annotated[tuple[NumberOrInfinite, ...], PER_AXIS]


class BoundaryPart(Concept):
    """The facets of the boundary that lie in all the places that are given."""

    on: Names = entry((), "boundary parts that contain the part; empty: the whole boundary")
    plane: Plane | None = entry(None, "a plane that contains the facets")
    box: tuple[_Corner, _Corner] | None = entry(
        None, "a box that contains the facets, by its least and greatest coordinates", "length"
    )
    expression: Condition | None = entry(
        None, "a condition on x, y, z that holds on the facets, such as x < 0.5 and y > 0"
    )
    facing: Direction | None = entry(
        None,
        "a vector along which the outward normals of the facets have a positive component: one lip "
        "of a cut",
        "1",
    )
    skin: Literal["inner", "outer"] | None = entry(
        None,
        "the facets of a connected boundary: inner, one that does not reach the outside of its "
        "body, as of a cavity or a crack, or outer",
    )

    def holds(self, x: FloatArray, rounding: float) -> BoolArray:
        """Which of the points x (d, k) are in the plane, in the box, and keep the condition."""
        inside = np.ones(x.shape[1], dtype=bool)
        if self.plane is not None:
            point, normal = np.array(self.plane.point), np.array(self.plane.normal)
            unit = normal / np.linalg.norm(normal)
            inside &= np.abs(unit @ x - unit @ point) <= rounding
        if self.box is not None:
            low, high = np.array(self.box)[:, :, None]
            inside &= np.all((x >= low - rounding) & (x <= high + rounding), axis=0)
        if self.expression is not None:
            condition = parse(self.expression, POSITION[: len(x)], condition=True)
            inside &= condition.numpy(**dict(zip(POSITION, x, strict=False))) > 0.0
        return inside

    def _faults(self) -> Iterator[Fault]:
        places = ("on", "plane", "box", "expression", "facing", "skin")
        if not any(getattr(self, place) for place in places):
            yield Fault((), f"needs a place: {', '.join(places[:-1])} or {places[-1]}")
        if self.box is not None:
            low, high = self.box
            if any(a > b for a, b in zip(low, high, strict=False)):
                yield Fault(("box",), "has the greatest coordinates before the least")

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if self.expression is not None:
            try:
                parse(self.expression, POSITION[: body.dim], condition=True)
            except InputError as error:
                yield Fault(("expression",), f"{error} in {body.dim}D")


class MeshParameters(Concept):
    """A builder with its own parameters, or a file with named physical groups."""

    builder: Text | None = entry("block", "a geometry by name")
    file: File | None = entry(
        None, "a Gmsh or XDMF file, relative to the study file, in place of a builder"
    )
    axisymmetric: Switch = entry(
        False,
        "the 2D mesh is the half section of a body of revolution, in the coordinates "
        "(r, z) = (x, y) with x >= 0",
    )
    parts: dict[Text, BoundaryPart] = entry(
        {}, "more parts of the boundary, by name; they may overlap"
    )
    geometry: Any = entry(None, "the builder's parameters", exclude=True)

    @property
    def dim(self) -> int | None:
        """Dimension of the body; None for a mesh file, which is read later."""
        return None if self.geometry is None else self.geometry.dim

    @classmethod
    def _completed(cls, data: dict[str, Any]) -> dict[str, Any]:
        of_builder = {key: value for key, value in data.items() if key not in _SHARED}
        shared = {key: value for key, value in data.items() if key in _SHARED}
        builder = data.get("builder")
        if data.get("file") is not None:
            refuse_if(
                Fault((key,), "does not go with file; a mesh comes from a builder or from a file")
                for key in (*(["builder"] if builder is not None else []), *of_builder)
            )
            return {**shared, "builder": None}
        if builder is None:
            builder = "block"
        if not isinstance(builder, str) or builder not in BUILDERS:
            guess = meant(builder, tuple(BUILDERS)) if isinstance(builder, str) else ""
            known = ", ".join(sorted(BUILDERS))
            message = f"unknown geometry {show(builder)}{guess}; there are {known}"
            refuse_if([Fault(("builder",), message)])
        return {**shared, "builder": builder, "geometry": _geometry(BUILDERS[builder], of_builder)}

    @model_serializer
    def _flat(self) -> dict[str, Any]:
        shared: dict[str, Any] = {"axisymmetric": True} if self.axisymmetric else {}
        if self.parts:
            shared["parts"] = {
                name: facets.model_dump(exclude_defaults=True)
                for name, facets in self.parts.items()
            }
        if self.file is not None:
            return {"file": self.file, **shared}
        return {"builder": self.builder, **asdict(self.geometry), **shared}

    @property
    def facet_names(self) -> tuple[str, ...]:
        """The boundary parts of a builder's mesh."""
        return (*self.geometry.facet_names, *self.parts)

    def _faults(self) -> Iterator[Fault]:
        if self.axisymmetric and self.geometry is not None:
            yield from _section_faults(str(self.builder), self.geometry)
        known = [] if self.geometry is None else list(self.geometry.facet_names)
        for name, facets in self.parts.items():
            if not name.isprintable() or not name:
                yield Fault(("parts",), "needs names that can be printed")
            if self.geometry is not None:
                if name in known:
                    yield Fault(("parts", name), "is the name of a part of the builder")
                for above in facets.on:
                    if above not in known:
                        names = ", ".join(known)
                        message = f"no part before this one is named '{above}'; there are {names}"
                        yield Fault(("parts", name, "on"), message)
                known.append(name)


def _section_faults(builder: str, geometry: Any) -> Iterator[Fault]:
    """The faults of a builder whose mesh is no half section of a body of revolution."""
    place = ("axisymmetric",)
    if geometry.dim != 2:
        section = "builder: disc with quarter: true" if builder == "ball" else "dim: 2"
        yield Fault(place, f"needs a mesh in two dimensions, the half section; use {section}")
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
            faults.append(Fault((key, *first["loc"]), value_message(first)))
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


class Region(Concept):
    """The material of a physical group of cells, as far as it differs from ``material``."""

    elasticity: Elasticity | None = entry(None, "elasticity tensor A; null: material.elasticity")
    locking_limit: PositiveScalarOrInfinite | None = entry(
        None, "M of this region; null: as in material", "1"
    )
    locking: StrainLimits | None = entry(
        None, "limits of the strain in this region, in place of all of material; null: as there"
    )

    def _faults(self) -> Iterator[Fault]:
        limits, ball = self.locking or (), self.locking_limit
        if limits and ball is not None and ball != math.inf:
            yield Fault(
                ("locking",),
                f"give either locking_limit: {show(ball)} or locking, in which the entry "
                f"{{norm: strain, at_most: {show(ball)}}} means the same",
            )
        for kind, number in Counter(type(limit) for limit in limits).items():
            if kind.once and number > 1:
                yield Fault(
                    ("locking",),
                    f"has {number} entries with norm: {kind.model_fields['norm'].default}; give "
                    "one, with the smaller limit (min(a, b) of two expressions)",
                )

    def limits(self) -> list[tuple[Place, StrainLimit]] | None:
        """The limits of the strain with their places, None for those of the material.

        ``locking_limit`` is the one of the norm ``strain``.
        """
        if self.locking:
            return [(("locking", index), limit) for index, limit in enumerate(self.locking)]
        if self.locking_limit is None:
            return None if self.locking is None else []
        return [(("locking_limit",), StrainBall(self.locking_limit))]


class MaterialParameters(Region):
    """Material (1): sigma in A eps(u) + dI_K(eps(u)), where K is the ball |xi| <= M of the paper.

    With a list of limits K is the intersection of all their sets.
    """

    elasticity: Elasticity = entry(Elasticity(), "elasticity tensor A")
    locking_limit: PositiveScalarOrInfinite = entry(
        Value(math.inf), "M, largest |eps(u)|; .inf: plain elasticity", "1"
    )
    locking: StrainLimits = entry(
        (), "limits of the strain, in place of locking_limit; all of them hold"
    )
    plane: Literal["strain", "stress"] = entry(
        "strain",
        "in 2D: plane strain, eps_zz = 0, or plane stress, sigma_zz = 0, where limits are those of "
        "the strain in the plane",
    )
    eigenstrain: Eigenstrains = entry(
        (), "strains that are not elastic: one section, or a list of sections, which add up"
    )
    regions: dict[str, Region] = entry({}, "other materials, by name of the group of cells")

    @property
    def eigenstrains(self) -> list[tuple[Place, Eigenstrain]]:
        """The sections of strains that are not elastic, with their places in the material."""
        if isinstance(self.eigenstrain, tuple):
            return [(("eigenstrain", i), section) for i, section in enumerate(self.eigenstrain)]
        return [(("eigenstrain",), self.eigenstrain)]

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.plane_stress and (body.dim != 2 or body.axisymmetric):
            where = "axisymmetric bodies" if body.axisymmetric else "bodies in 3D"
            yield Fault(("plane",), f"stress is for bodies in 2D, not for {where}")


# All tractions, pressures and forces are compiled into one form, which takes seconds for 200 of
# them and fails for some 2000.
_MOST_TRACTIONS = 200


class LoadParameters(Concept):
    """Body force f0, tractions g, pressures, prescribed displacements and supports, (2)-(4)."""

    body_force: TimedVector | None = entry(None, "components of f0; null: none", "force/volume")
    tractions: Annotated[tuple[Traction, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their g"
    )
    pressures: Annotated[tuple[Pressure, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with their pressure; several loads on one part add up"
    )
    forces: Annotated[tuple[TotalForce, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of Gamma_N with the total of their tractions, which are spread evenly"
    )
    displacements: tuple[Displacement, ...] = entry((), "parts of Gamma_D with their u")
    supports: tuple[Support, ...] = entry(
        (), "parts of Gamma_D that are held along their normal or along a given direction"
    )

    springs: Annotated[tuple[Spring, ...], Field(max_length=_MOST_TRACTIONS)] = entry(
        (), "parts of the boundary on springs, which hold the body"
    )

    def of(self, *kinds: str) -> list[Any]:
        """The entries of some kinds, each with its key."""
        return [
            concept.model_copy(update={"at": dotted("loads", kind, number)})
            for kind in kinds
            for number, concept in enumerate(getattr(self, kind))
        ]

    @property
    def acting(self) -> list[Load]:
        """The loads, each with its key."""
        force = self.body_force
        whole = [] if force is None else [BodyForce(force, at="loads.body_force")]
        return [*whole, *self.of("forces", "tractions", "pressures")]

    @property
    def held(self) -> list[Support | Displacement]:
        """The prescribed displacements, each with its key."""
        return self.of("supports", "displacements")

    def numbers(self) -> Iterator[tuple[str, Value]]:
        """The key and the number or expression of each component that loads the body."""
        for load in (*self.acting, *self.held):
            for place, value in leaves(load.value, place_of((), load, "value")):
                if value is not None:
                    yield dotted(load.key, *place), value


#: Names that a table may not have.
_TAKEN = {*POSITION, TIME, "s", "inf", *CONSTANTS, *FUNCTIONS}
_MOST_TABLES = 50


def name_faults(names: Iterable[str], what: str) -> Iterator[Fault]:
    """The names of tables or numbers, in words ``what``, that expressions cannot use."""
    names = list(names)
    if len(names) > _MOST_TABLES:
        yield Fault((), f"has {len(names)} {what}; at most {_MOST_TABLES} are allowed")
    for name in names:
        if not (name.isascii() and name.isidentifier()) or iskeyword(name):
            yield Fault((name,), "is not a valid name in expressions; use letters, digits and _")
        elif name in _TAKEN:
            yield Fault((name,), "is already a name in expressions; use another one")
