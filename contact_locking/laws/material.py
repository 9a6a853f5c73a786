"""The elasticity of the body, and strains that cost no stress."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import BeforeValidator, Field, Tag

from contact_locking.arrays import FloatArray
from contact_locking.laws.limits import size_faults
from contact_locking.values.concept import (
    LIST,
    SECTION,
    BodyKind,
    Concept,
    Fault,
    dotted,
    entry,
    hidden,
    leaves,
    refuse_if,
)
from contact_locking.values.kinds import (
    MandelMatrix,
    Names,
    PoissonScalar,
    PositiveScalar,
    Scalar,
    Strain,
    Tensor,
    list_or,
)
from contact_locking.values.value import Value, show

_MOST_ENTRIES = 50


class Eigenstrain(Concept):
    """eps_0 of sigma = A (eps(u) - eps_0): a strain that costs no stress.

    A number is the same strain in all directions, also across the plane of a body in two
    dimensions. A list has the normal strains, and rows those of a symmetric tensor.
    """

    value: Tensor | None = entry(None, "eps_0: a number, normal strains, or rows of a tensor", "1")
    expansion: Tensor | None = entry(
        None, "strain for a unit of temperature, as value", "1/temperature"
    )
    temperature: Strain | None = entry(None, "how much warmer than without stress", "temperature")
    on: Names | None = entry(None, "name(s) of groups of cells; null: the whole body")

    @property
    def tensor(self) -> tuple[str, Any]:
        """The key of the tensor and its value."""
        if self.value is not None:
            return "value", self.value
        return "expansion", self.expansion

    def sampler(self, points: Any) -> Callable[[], FloatArray]:
        """A function that returns the present tensors (k, 3, 3) at the points; both are collective.

        ``points`` are :class:`~contact_locking.problem.points.Points`.
        """
        (name, tensor), entries = self.tensor, list[tuple[list[Any], Any]]()
        for place, value in leaves(tensor, ()):
            # A function of points gives whole tensors, as an expression of UFL may.
            is_whole = value.expression is None and callable(value.data) and not place
            shape = getattr(value.data, "ufl_shape", (3, 3) if is_whole else ())
            slots: list[Any] = [place]
            if not shape and len(place) < 2:  # a normal strain, or the number of all three
                slots = [(i, i) for i in place or range(3)]
            entries.append((slots, points.sampler(value, dotted(name, *place), shape)))
        warm = points.sampler(1.0 if self.temperature is None else self.temperature, "temperature")

        def tensors() -> FloatArray:
            tensors_now = np.zeros((len(points.of(points.cells)), 3, 3))
            for slots, read in entries:
                values = read()
                for place in slots:
                    tensors_now[:, *place] = values
            return tensors_now * warm()[:, None, None]

        return tensors

    def _faults(self) -> Iterator[Fault]:
        if (self.value is None) == (self.expansion is None):
            yield Fault((), "give either value, or expansion and temperature")
        elif self.value is not None and self.temperature is not None:
            yield Fault(("temperature",), "belongs to expansion, not to value")
        elif self.expansion is not None and self.temperature is None:
            yield Fault(("temperature",), "is missing; expansion needs it")
        key, tensor = self.tensor
        if isinstance(tensor, tuple):
            yield from _tensor_faults(key, tensor)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        key, tensor = self.tensor
        if not isinstance(tensor, tuple):
            return
        sizes = (3,) if body.axisymmetric else tuple(sorted({body.dim, 3}))
        if len(tensor) not in sizes:
            number = " or ".join(map(str, sizes))
            what = "rows" if isinstance(tensor[0], tuple) else "normal strains"
            order = " (r, z, hoop)" if body.axisymmetric else ""
            yield Fault((key,), f"must have {number} {what}{order} {body}, not {len(tensor)}")
        elif isinstance(tensor[0], tuple) and body.dim == 2 and len(tensor) == 3:
            for i in range(2):
                if tensor[i][2] != 0.0:
                    what = "the hoop" if body.axisymmetric else "the axis across the plane"
                    yield Fault((key, i, 2), f"must be 0 {body}, where nothing shears along {what}")


def _tensor_faults(key: str, tensor: tuple[Any, ...]) -> Iterator[Fault]:
    rows = [row for row in tensor if isinstance(row, tuple)]
    if not tensor or (rows and {len(row) for row in tensor if row in rows} != {len(tensor)}):
        yield Fault((key,), "must be a number, normal strains, or the rows of a square tensor")
    elif rows and len(rows) != len(tensor):
        yield Fault((key,), f"mixes numbers and rows: {show(tensor)}")
    elif rows:
        for j, i in itertools.combinations(range(len(tensor)), 2):
            if tensor[i][j] != tensor[j][i]:
                yield Fault(
                    (key, i, j),
                    f"not symmetric: it is {show(tensor[i][j])}, and row {j + 1}, column {i + 1} "
                    f"is {show(tensor[j][i])}",
                )


_Several = Annotated[tuple[Eigenstrain, ...], Field(max_length=_MOST_ENTRIES), Tag(LIST)]
Eigenstrains: TypeAlias = Annotated[
    Annotated[Eigenstrain, Tag(SECTION)] | _Several, list_or(SECTION)
]

_STIFFNESS = (
    "A as 3x3 (2D) or 6x6 matrix in Mandel's notation, symmetric and elliptic; 4x4 (rr, zz, hoop, "
    "rz) of an axisymmetric body"
)
# The keys that go together.
_CHOICES = (("young", "poisson"), ("lambda", "mu"), ("stiffness",), ("<stress>",))


def _eigenstrain(value: Any) -> Any:
    return value if value is None or isinstance(value, Eigenstrain) else Eigenstrain(value)


class Elasticity(Concept):
    """``sigma = A eps``, or ``sigma = A eps + sigma_0`` for a stress that is affine in the strain.

    A is isotropic with ``young`` and ``poisson``, or with ``lame_lambda`` and ``lame_mu``; or it is
    the symmetric and elliptic Mandel matrix ``stiffness`` (s, s).  All data are numbers or
    expressions of x, y and z; in scripts also constants or functions of DOLFINx, expressions of
    UFL, or functions of points (d, k).

    In scripts alone ``stress`` maps a UFL strain to a stress, as in ``lambda e: C(e) - a*T*I``.
    ``eigenstrain`` is eps_0 of ``sigma = A (eps - eps_0)`` as (3, 3) tensors, or an
    :class:`Eigenstrain`, beside A itself.  In plane strain the entry across the plane counts, with
    an isotropic A; with ``stiffness`` it must be zero.  In plane stress it has no effect.
    ``plane`` is "strain" or "stress".  ``rotational`` is a density that has to vanish.
    """

    young: PositiveScalar | None = entry(Value.of(1.0), "Young's modulus E", "stress")
    poisson: PoissonScalar | None = entry(Value.of(0.3), "Poisson's ratio", "1")
    lame_lambda: Scalar | None = entry(
        None, "Lame's first parameter, in place of E and nu", "stress", alias="lambda"
    )
    lame_mu: PositiveScalar | None = entry(None, "shear modulus, with lambda", "stress", alias="mu")
    stiffness: MandelMatrix | None = entry(None, _STIFFNESS, "stress")
    stress: Any = hidden("stress")
    eigenstrain: Annotated[Eigenstrain | None, BeforeValidator(_eigenstrain)] = hidden(
        "eigenstrain"
    )
    plane: Literal["strain", "stress"] | None = hidden("plane")
    rotational: Any = hidden("rotational")

    @property
    def lame_names(self) -> tuple[str, str]:
        """The names of the two numbers of an isotropic A."""
        return ("lame_lambda", "lame_mu") if self.young is None else ("young", "poisson")

    @classmethod
    def _completed(cls, data: dict[str, Any]) -> dict[str, Any]:
        stated = {key for key, value in data.items() if value is not None}
        chosen = [choice for choice in _CHOICES if stated & set(choice)]
        if len(chosen) > 1:
            keys = ", ".join(
                key.strip("<>") for choice in chosen for key in choice if key in stated
            )
            choices = ", or ".join(" and ".join(choice) for choice in _CHOICES[:3])
            refuse_if([Fault((), f"give {choices}; not {keys} together")])
        if not chosen or chosen[0] == _CHOICES[0]:
            return {key: value for key, value in data.items() if value is not None}
        missing = [key for key in chosen[0] if key not in stated]
        refuse_if(Fault((key,), f"is missing; {chosen[0][0]} needs it") for key in missing)
        return {"young": None, "poisson": None, **data}

    def _faults(self) -> Iterator[Fault]:
        if isinstance(self.stiffness, tuple):
            yield from _stiffness_faults(self.stiffness)
        if self.eigenstrain is not None and (self.stress is not None or self.eigenstrain.on):
            message = (
                "has an eigenstrain and a stress, which must include it, or one on groups of cells"
            )
            yield Fault((), message)

    def _faults_in(self, body: BodyKind) -> Iterator[Fault]:
        first, second = self.lame_lambda, self.lame_mu
        if first and second and first.number is not None and second.number is not None:
            # With sigma_zz = 0 the inverse of A is positive if it is so in three dimensions.
            number = 3 if body.plane_stress else body.strains
            bulk = number * first.number + 2 * second.number
            if bulk <= 0:
                yield Fault(
                    ("lambda",),
                    f"not elliptic: {number} lambda + 2 mu = {bulk:g} must be > 0 {body}",
                )
        yield from size_faults("stiffness", self.stiffness, body)
        if self.stiffness is not None and body.plane_stress:
            yield Fault(
                ("stiffness",),
                "does not go with plane stress; give the matrix of plane stress itself, which maps "
                "the strains of the plane to its stresses, and leave out plane",
            )


def _stiffness_faults(rows: tuple[tuple[Value, ...], ...]) -> Iterator[Fault]:
    place = ("stiffness",)
    values = np.array([[np.nan if v.number is None else v.number for v in row] for row in rows])
    scale = np.nanmax(np.abs(values), initial=0.0)
    # A difference is not a number if an expression is in it, and is not compared.
    for i, j in np.argwhere(np.triu(np.abs(values - values.T) > 1e-9 * scale)):
        yield Fault(
            place,
            f"not symmetric: row {i + 1}, column {j + 1} is {values[i, j]:g} but "
            f"row {j + 1}, column {i + 1} is {values[j, i]:g}",
        )
        return
    if not np.isnan(values).any():
        smallest = np.linalg.eigvalsh(values / (scale or 1.0))[0] * scale
        if smallest <= 1e-12 * scale:
            yield Fault(
                place, f"not elliptic: its smallest eigenvalue is {smallest:.6g} and must be > 0"
            )
