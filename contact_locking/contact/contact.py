"""The data of a contact: place, rigid foundation or other body, and friction with its smoothing R.

Study files are read without DOLFINx: functions that need a mesh import what they use themselves.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Tag, ValidationInfo, WrapValidator, create_model

from contact_locking.arrays import BoolArray, IntArray
from contact_locking.errors import InputError, with_key
from contact_locking.findings import Finding
from contact_locking.shapes import analytic as analytic
from contact_locking.shapes import faceted as faceted
from contact_locking.shapes.shape import SHAPES, Distance, RigidMotion, Shape, rotation
from contact_locking.values.concept import (
    LIST,
    SECTION,
    BodyKind,
    Components,
    Concept,
    Fault,
    Place,
    dotted,
    entry,
    hidden,
)
from contact_locking.values.kinds import (
    Direction,
    NonNegative,
    NonNegativeSlipScalar,
    Places,
    Point,
    Positive,
    PositiveNumber,
    Text,
    TimedScalar,
    TimeScalar,
    TimeVector,
    components,
    list_or,
)
from contact_locking.values.value import Value, show, vector_at

if TYPE_CHECKING:
    from contact_locking.contact.coulomb import FrictionBound, Smoothing
    from contact_locking.contact.surface import ContactSurface

_Rotation = Annotated[
    Annotated[tuple[TimeScalar, ...], Components(3), Tag(LIST)]
    | Annotated[TimeScalar, Tag(SECTION)],
    list_or(SECTION),
    BeforeValidator(components),
]


class Motion(Concept):
    """``x = about + R (X - about) + translation`` for the points X of a foundation at rest.

    Each component is a number, an expression of t, or a constant of DOLFINx; without motion x = X.
    """

    translation: TimeVector | None = entry(
        None, "components of the displacement; null: none", "length"
    )
    rotation: _Rotation | None = entry(
        None, "angle, in 3D the components of a rotation vector; null: none", "rad"
    )
    about: Point | None = entry(
        None, "the point of the tool at rest about which the tool turns", "length"
    )

    def _faults(self) -> Iterator[Fault]:
        if self.translation is None and self.rotation is None:
            yield Fault((), "has no motion: give translation, rotation or both")
        if (self.rotation is None) != (self.about is None):
            names = ("about", "rotation")
            missing, present = names if self.about is None else names[::-1]
            yield Fault((missing,), f"is missing; {present} needs it")

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if body.dim == 2 and isinstance(self.rotation, tuple):
            yield Fault(("rotation",), "is one angle in 2D, and no list")
        if body.dim == 3 and isinstance(self.rotation, Value):
            message = "is a vector with 3 components in 3D: the axis times the angle"
            yield Fault(("rotation",), message)
        if body.axisymmetric:
            yield from radial_faults(("translation",), self.translation)
            if self.rotation is not None:
                message = "must be left out: an axisymmetric body has no rotation in its section"
                yield Fault(("rotation",), message)

    def at(self, time: float, dim: int) -> RigidMotion:
        """The motion from rest at a time.  Raises InputError, with the key of a component."""
        zero = (Value.of(0.0),) * dim
        angles = self.rotation or zero[:1] * (1 if dim == 2 else 3)
        angles = angles if isinstance(angles, tuple) else (angles,)
        return RigidMotion(
            with_key("translation", lambda: vector_at(self.translation or zero, time)),
            rotation(with_key("rotation", lambda: vector_at(angles, time))),
            np.array(self.about or (0.0,) * dim, dtype=float),
        )


class FoundationSpring(Concept):
    """A spring that holds a foundation: ``-k q`` along a line for its travel q."""

    stiffness: PositiveNumber = entry(
        ..., "k, the force per travel; in 2D for a unit of thickness", "force/length"
    )
    along: Direction | None = entry(None, "its line, of any length; null: the line of force", "1")


_Moved = Annotated[
    Annotated[Motion, Tag(SECTION)] | Annotated[TimeVector, Tag(LIST)], list_or(SECTION)
]

_FIELDS: dict[str, Any] = {
    key: (shape | None, entry(None, shape.text, shape.unit)) for key, shape in SHAPES.items()
}
_Shapes: Any = create_model("_Shapes", __base__=Concept, **_FIELDS)


class Foundation(_Shapes):
    """A rigid body that the deformed body does not enter: shape, motion, and forces on it.

    In scripts the first argument is a shape, or any object with the methods of
    :class:`~contact_locking.shapes.shape.Distance`.
    """

    motion: _Moved | None = entry(
        None, "motion of the rigid body from rest; a list is the translation", "length"
    )
    force: TimeVector | None = entry(
        None,
        "components of the force that pushes the rigid body against the body: its displacement "
        "along the force is an unknown; null: the place of the rigid body is known",
        "force, in 2D force/length",
    )
    spring: FoundationSpring | None = entry(
        None,
        "the rigid body gives way along a line by force/stiffness, beyond its motion; a force is "
        "its preload; null: no spring",
    )
    custom: Any = hidden("custom")

    def __init__(self, shape: Distance | None = None, **named: Any) -> None:
        if shape is not None:
            key = shape.key if isinstance(shape, Shape) else ""
            named[key if key in _FIELDS else "custom"] = shape
        super().__init__(**named)

    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]

    @property
    def shape(self) -> Distance:
        """The shape at rest."""
        return next(x for key in ("custom", *_FIELDS) if (x := getattr(self, key)) is not None)

    @property
    def shape_key(self) -> str:
        """The key of the shape, empty for another object of a script."""
        return self.shape.key if isinstance(self.shape, Shape) else ""

    @property
    def file(self) -> str | None:
        """The file with the shape, if it is in one."""
        return getattr(self.shape, "file", None)

    @property
    def moved(self) -> Motion | None:
        """The motion with all its parts; None for a body at rest."""
        return Motion(self.motion) if isinstance(self.motion, tuple) else self.motion

    @property
    def is_free(self) -> bool:
        """Whether the place of the foundation is unknown: forces decide."""
        return self.force is not None or self.spring is not None

    def _faults(self) -> Iterator[Fault]:
        shapes = [key for key in (*_FIELDS, "custom") if getattr(self, key) is not None]
        if len(shapes) != 1:
            listed = ", ".join(_FIELDS)
            message = f"give exactly one of {listed}, not {' and '.join(shapes) or 'none'}"
            yield Fault((), message)
        methods = ("gap", "contact_normal")
        is_distance = all(callable(getattr(self.custom, name, None)) for name in methods)
        if self.custom is not None and (isinstance(self.custom, type) or not is_distance):
            message = (
                "must be a shape such as Sphere(centre, radius), or an object with gap(x) and "
                f"contact_normal(x), not {type(self.custom).__name__}"
            )
            yield Fault((), message)
        if self.force is not None and all(component == 0 for component in self.force):
            message = "is zero, so that nothing pushes the foundation; leave it out for a fixed one"
            yield Fault(("force",), message)
        if self.spring is not None and (self.spring.along is None) == (self.force is None):
            message = (
                "is missing: the direction in which the spring gives way"
                if self.force is None
                else "is given twice: the spring acts along force; leave it out"
            )
            yield Fault(("spring", "along"), message)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        if not body.axisymmetric:
            return
        yield from radial_faults(("force",), self.force)
        if self.spring is not None:
            yield from radial_faults(("spring", "along"), self.spring.along)
        if isinstance(self.motion, tuple):
            yield from radial_faults(("motion",), self.motion)


def radial_faults(place: Place, vector: Sequence[object] | None) -> Iterator[Fault]:
    """A vector with a component across the axis of a body of revolution."""
    if vector is not None and vector[0] != 0:
        message = f"must be 0 across the axis of an axisymmetric body, not {show(vector[0])}"
        yield Fault((*place, 0), message)


# The sizes of facets have rounding errors: at a radius of just one facet R does nothing.
_SIZE_ROUNDING = 1e-9


class Kernel(ABC):
    """A smoothing R as data: :meth:`on` makes it for a surface."""

    @abstractmethod
    def on(self, surface: ContactSurface, free: BoolArray, sides: IntArray) -> Smoothing:
        """R on a surface; collective.

        Nodes that are not ``free`` (k,) have no pressure, and each of the ``sides`` (n,) of the
        surface is smoothed alone (`ContactSurface.sides`).
        """

    def findings(self, surface: ContactSurface) -> list[Finding]:
        """Findings about its data, with keys below its own; collective."""
        return []


def _own_kernel(value: Any, handler: Any) -> Any:
    return value if isinstance(value, Kernel) else handler(value)


class Mollifier(Concept, Kernel):
    """R, the mollifier of the normal stress along Gamma_C."""

    kernel: Literal["convolution", "helmholtz", "none"] | None = entry(
        None,
        "convolution, helmholtz (I - r^2 Laplace_Gamma), or none: local Coulomb; null: convolution",
    )
    radius: Positive | None = entry(
        None,
        "r, of the kernel, measured along Gamma_C; null: a tenth of the extent of Gamma_C, two "
        "facets at least",
        "length",
    )

    def over(self, common: Mollifier) -> Mollifier:
        """``common``, in which the values stated here replace those there."""
        return common.model_copy(update=self.stated())

    def on(self, surface: ContactSurface, free: BoolArray, sides: IntArray) -> Smoothing:
        from contact_locking.contact import coulomb

        if self.kernel == "none":
            return coulomb.Identity()
        comm, whole = surface.domain.comm, surface.whole(free, sides)
        radius = coulomb.default_radius(surface) if self.radius is None else self.radius
        if self.kernel == "helmholtz":
            radius = min(radius, coulomb.LARGEST_RADIUS_SHARE * coulomb.extent_of(surface))
            return coulomb.HelmholtzOperator(comm, whole, surface.laplacian(sides), radius)
        return coulomb.ConvolutionOperator(comm, whole, radius)

    def findings(self, surface: ContactSurface) -> list[Finding]:
        size = surface.domain.facet_diameter(surface.facets)
        is_wide = self.radius is None or self.radius > size * (1.0 + _SIZE_ROUNDING)
        if is_wide or self.kernel == "none":
            return []
        on = ", ".join(surface.names)
        return [Finding("smoothing.radius", "radius", radius=self.radius, size=size, on=on)]


def Convolution(radius: float | None = None) -> Mollifier:
    """``R w(x) = int k(|x - y|/r) w(y) / int k(|x - y|/r)``, k a smooth bump with the radius r.

    ``radius`` is r, a length; without one it is a tenth of the extent of the contact, and twice its
    longest facet at least.
    """
    return Mollifier("convolution", radius)


def Helmholtz(radius: float | None = None) -> Mollifier:
    """``(I - r^2 Laplace_Gamma) R w = w`` with natural conditions at the edge of the contact."""
    return Mollifier("helmholtz", radius)


def Local() -> Mollifier:
    """``R w = w``: local Coulomb friction."""
    return Mollifier("none")


class Coulomb(Concept):
    """``|sigma_tau| <= mu(x, s) |R sigma_nu|`` (6), with s the accumulated slip.

    ``coefficient`` is mu: a finite number, an expression, a constant of DOLFINx, a function of
    points (k, d) and slips (k,), or a :class:`~contact_locking.contact.coulomb.FrictionLaw`.  What
    is None is as in the section ``friction`` of a study file.  A user's own friction bound is a
    subclass whose :meth:`on` returns another :class:`FrictionBound`.
    """

    coefficient: NonNegativeSlipScalar | None = entry(
        None, "mu >= 0, a number or an expression of x, y, z and s = |u_tau|; null: 0", "1"
    )
    smoothing: Annotated[Mollifier, WrapValidator(_own_kernel)] | None = entry(
        None, "the mollifier R"
    )
    regularisation: NonNegative | None = entry(
        None,
        "the slip at which friction reaches 71 % of its bound, eps of (22); 0: Coulomb's law "
        "itself, without regularisation; null: penalty.epsilon times Young's modulus",
        "length",
    )

    def over(self, common: Coulomb) -> Coulomb:
        """``common``, in which the values stated here replace those there."""
        values = self.stated()
        if isinstance(self.smoothing, Mollifier):
            values["smoothing"] = self.smoothing.over(common.smoothing or Mollifier())
        return common.model_copy(update=values)

    @property
    def kernel(self) -> Kernel:
        """R."""
        return Mollifier() if self.smoothing is None else self.smoothing

    @property
    def is_zero(self) -> bool:
        """Whether there is no friction."""
        return self.coefficient is None or self.coefficient.number == 0.0

    def on(self, surface: ContactSurface, smoothing: Smoothing) -> FrictionBound:
        """The friction bound on a surface, with R there."""
        from contact_locking.contact.coulomb import FrictionBound, Identity

        # Without friction R is not needed, and its matrix would be made only for a field.
        kernel = Identity() if self.is_zero else smoothing
        return FrictionBound(surface, kernel, self.coefficient, self.is_zero)


def _foundation_at_rest(value: Any, info: ValidationInfo) -> Any:
    """In scripts a shape alone is a foundation at rest."""
    is_foundation = value is None or isinstance(value, dict | Foundation)
    return value if is_foundation or info.context is not None else Foundation(value)


class Contact(Concept):
    """``u_nu <= gap``, ``sigma_nu <= 0``, ``(u_nu - gap) sigma_nu = 0`` (5) and friction (6).

    ``on`` is the possible place of contact: names of boundary parts; in a script also local indices
    of exterior facets (k,), or a pair of mesh tags and a value.  ``foundation`` is a
    :class:`Foundation`, or its shape alone; without one the ``gap`` g is along the outward normal.

    ``against`` is the place of the other side, on another body of the mesh or across a cut of the
    same body; it shares no node with ``on`` except at the tip of a crack.  Contact then limits the
    jump ``[u] = u - u o chi`` between the sides, with the points chi(x) of ``against`` that the
    normals of ``on`` meet.  The gap adds to the distance of the sides in the mesh; a negative gap
    is an overlap that presses, as in a press fit.
    """

    on: Places = entry(("bottom",), "name(s) of the parts of Gamma_C; []: no contact")
    foundation: Annotated[Foundation | None, BeforeValidator(_foundation_at_rest)] = entry(
        None, "a rigid body, in place of gap"
    )
    friction: Coulomb | None = entry(
        None, "friction on this part; what it leaves out is as under friction"
    )
    gap: TimedScalar = entry(
        Value.of(0.0),
        "distance to the foundation along nu; with against: beyond the distance in the mesh",
        "length",
    )
    against: Places | None = entry(
        None,
        "name(s) of the parts of another body, or of the other side of a cut, that on touches; "
        "those of on: bodies touch each other; null: a foundation",
    )
    pair: Literal["once", "each_step"] | None = entry(
        None,
        "with against: find the points that face each other, and the normals, at the solution of "
        "each_step, or once, on the undeformed mesh; null: each_step",
    )
    name: Text | None = entry(
        None,
        "the name of the contact in results, as in contact_force_NAME_x of history.csv; null: the "
        "first of on",
    )
    at: Any = hidden("at")
    shared: Any = hidden("shared")

    @property
    def key(self) -> str:
        """The name of the contact in messages."""
        return self.at or "contact"

    def over(self, friction: Coulomb, at: str) -> Contact:
        """The contact at a key of a study file, whose section ``friction`` holds for it as well."""
        friction_own = self.friction or Coulomb()
        whole = friction_own.over(friction)
        shared = [name for name in whole.stated() if getattr(friction_own, name) is None]
        return self.model_copy(update={"at": at, "friction": whole, "shared": shared})

    def friction_key(self, *place: str) -> str:
        """The key of a value of friction, which may stand in the section of all contacts."""
        is_shared = place[0] in (self.shared or ())
        return dotted("friction" if is_shared else f"{self.key}.friction", *place)

    @property
    def is_free(self) -> bool:
        """Whether the place of the foundation is unknown: forces decide."""
        return self.foundation is not None and self.foundation.is_free

    def _faults(self) -> Iterator[Fault]:
        if self.name is not None and (not self.name.strip() or "." in self.name):
            message = "must be a word without dots, as it is a part of keys such as contacts.NAME"
            yield Fault(("name",), message)
        if self.foundation is not None and self.gap != 0:
            message = "the foundation defines the gap; give either gap or foundation"
            yield Fault(("gap",), message)
        if self.against is None:
            if self.pair is not None:
                message = "is about two bodies; name the other one in against, or leave out pair"
                yield Fault(("pair",), message)
            return
        if not len(self.against):
            yield Fault(("against",), "needs the name of a boundary part; leave it out without one")
        if self.foundation is not None:
            message = "a contact is with a foundation or with another body; leave out one of both"
            yield Fault(("against",), message)
        if all(isinstance(name, str) for name in (*self.on, *self.against)):
            both = [name for name in self.against if name in self.on]
            if both and {*self.on} != {*self.against}:
                message = f"'{both[0]}' is in on as well; bodies that touch share all names"
                yield Fault(("against",), message)


def named(contacts: Sequence[Contact]) -> list[Contact]:
    """The contacts with unique names: a contact without one gets that of its first boundary part.

    Raises InputError for a name that two contacts have.
    """
    taken: set[str] = set()
    for contact in contacts:
        if contact.name in taken:
            raise InputError(f"'{contact.name}' is the name of another contact", contact.key)
        taken |= {contact.name or ""} - {""}
    renamed = []
    for contact in contacts:
        # The names are parts of dotted keys.
        first = str(next(iter(contact.on))).replace(".", "_")
        others = (f"{first}_{number}" for number in itertools.count(2))
        free = (name for name in itertools.chain([first], others) if name not in taken)
        name = contact.name or next(free)
        taken.add(name)
        renamed.append(contact.model_copy(update={"name": name}))
    return renamed
