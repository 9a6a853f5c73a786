"""The base class of the shapes of foundations, for scripts and study files."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import ValidationInfo, model_validator

from contact_locking.arrays import FloatArray
from contact_locking.shapes.distance import Distance
from contact_locking.values.concept import ONLY, Concept

if TYPE_CHECKING:
    from mpi4py import MPI


#: The shapes by their keys in a study file.
SHAPES: dict[str, type[Shape]] = {}


class Shape(Concept):
    """A signed distance ``phi(x)``.

    ``key`` is the key of the shape in a study file, ``text`` and ``unit`` its description there.
    ``is_distance`` says that phi is exact everywhere, so that it changes by no more than the way.
    ``turn`` says how to turn it if it is inside out, and ``turn_normal`` if it lies behind the
    body.
    """

    key: ClassVar[str] = ""
    text: ClassVar[str] = ""
    unit: ClassVar[str] = ""
    is_distance: ClassVar[bool] = True
    is_plane: ClassVar[bool] = False
    turn: ClassVar[str] = ""
    turn_normal: ClassVar[str] = ""

    @classmethod
    def __pydantic_init_subclass__(cls, **more: Any) -> None:
        if "key" in cls.__dict__:
            SHAPES[cls.key] = cls

    @model_validator(mode="before")
    @classmethod
    def _from_value(cls, data: Any, info: ValidationInfo) -> Any:
        """A shape that is one value stands in a study file without a mapping."""
        is_short = ONLY in {field.alias for field in cls.model_fields.values()}
        is_value = info.context is not None or not isinstance(data, dict)
        return {ONLY: data} if is_short and is_value and not isinstance(data, cls) else data

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> Any:
        schema = handler(core)
        resolved = handler.resolve_ref_schema(schema)
        if (value := resolved["properties"].get(ONLY)) is not None:
            resolved.clear()
            resolved.update(value)
        return schema

    @abstractmethod
    def gap(self, x: FloatArray) -> FloatArray:
        """``phi(x)`` (k,) at points (d, k): the signed distance, negative inside."""

    @abstractmethod
    def contact_normal(self, x: FloatArray) -> FloatArray:
        """``-grad phi(x)`` (d, k): unit vectors that point into the foundation."""

    def read(self, comm: MPI.Intracomm) -> Shape:
        """The shape with what is in its files; collective."""
        return self

    @property
    def is_timed(self) -> bool:
        """Whether the shape itself changes with the time."""
        return False

    def at(self, time: float) -> Distance:
        """The shape at a time."""
        return self

    @property
    def warnings(self) -> list[str]:
        """Warnings about a shape that is probably not intended."""
        return []


class OwnShape(Shape):
    """The signed distance of an object that a script defines."""

    is_distance = False
    turn_normal = ", or turn its contact_normal, which points into the foundation"

    distance: Any

    def gap(self, x: FloatArray) -> FloatArray:
        return self.distance.gap(x)

    def contact_normal(self, x: FloatArray) -> FloatArray:
        return self.distance.contact_normal(x)
