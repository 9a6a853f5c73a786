"""The points of the strains in all cells, the values of data there, and limits of the strain."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import SMALLEST, BoolArray, FloatArray, IndexArray
from contact_locking.errors import InputError
from contact_locking.fem import compiled
from contact_locking.fem.fields import Clock, PresentValue
from contact_locking.fem.spaces import Element
from contact_locking.laws.limits import StrainBall, StrainLimit
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import minimum, on_any_rank
from contact_locking.problem.strain_sets import HalfSpaceSet, Limited, NormSet, Sampler
from contact_locking.values.concept import dotted, marked
from contact_locking.values.kinds import ScalarRule
from contact_locking.values.value import Value

Check = Callable[[FloatArray, str], None]


@dataclass(frozen=True)
class Placed:
    """A concept or value with its key, in some local cells; in all of them if ``cells`` is None.

    ``short`` is the key of its only value, if a study file gives that without the concept.
    """

    content: Any
    key: str
    cells: IndexArray | None = None
    short: str = ""

    def key_of(self, *place: str | int) -> str:
        """The key of a value of a concept."""
        return self.short or dotted(self.key, *place)


@dataclass(frozen=True)
class InCells:
    """Values by cells, of which the last one counts where cells overlap, else ``elsewhere``."""

    parts: Sequence[Placed]
    elsewhere: float


class Points:
    """The k points of the strains in all local cells, numbered cell by cell.

    - ``places``: (d, k) the coordinates of the points
    - ``dofs``, ``all``: (k,) the dofs of the points in ``space``, and their numbers
    - ``size``, ``pairs``: strains are (size, size) tensors with these Mandel pairs
    - ``cells``, ``clock``: where and at which time data are evaluated
    - ``root``, ``name``: the key of the concept that has the data, and its name in results
    """

    root, name = "", ""
    cells: IndexArray | None = None

    def __init__(self, domain: Domain, element: Element, clock: Clock) -> None:
        self.domain, self.element, self.clock = domain, element, clock
        self.size = domain.kinematics.tensor_size(domain.dim)
        self.pairs = domain.kinematics.mandel_pairs(domain.dim)
        self.places = element.strain_places(domain.mesh)
        self.all = np.arange(self.places.shape[1], dtype=np.int32)
        self.space = element.strain_space(domain.mesh)
        self.in_cell = self.space.dofmap.list.shape[1]
        self.dofs = self.space.dofmap.list.reshape(-1)

    def for_key(self, root: str, cells: IndexArray | None = None) -> Points:
        """The same points for the data of another concept, with its key and cells."""
        points = copy.copy(self)
        points.root, points.name, points.cells = root, root.removeprefix("material."), cells
        return points

    def of(self, cells: IndexArray | None) -> IndexArray:
        """The numbers of the points in the given cells, or in all cells."""
        return self.all if cells is None else self.all.reshape(-1, self.in_cell)[cells].reshape(-1)

    def function(self, shape: tuple[int, ...] = ()) -> fem.Function:
        """A function in the space of strains, with values of the given shape; collective."""
        space = self.element.strain_space(self.space.mesh, shape) if shape else self.space
        return fem.Function(space)

    def write(self, function: fem.Function, values: FloatArray) -> None:
        """Set the values (k, ...) of a function of the space of strains."""
        dofs = function.function_space.dofmap.list.reshape(-1)
        function.x.array.reshape(-1, *function.ufl_shape)[dofs] = values

    def values(self, function: fem.Function) -> FloatArray:
        """The values (k, ...) of a function of the space of strains."""
        dofs = function.function_space.dofmap.list.reshape(-1)
        return np.asarray(function.x.array.reshape(-1, *function.ufl_shape)[dofs])

    def sampler(
        self, value: Any, name: str = "", shape: tuple[int, ...] = (), check: Check | None = None
    ) -> Sampler:
        """A function that returns the present values (k, ...) of data at the points in ``cells``.

        The data are a :class:`Value` or its content, tuples of these, or `InCells`; they are
        compiled once.  The function raises InputError with the key and ``name`` for a value that is
        not finite, and the errors of ``check(values, key)``.  Both are collective.
        """
        data = value.data if isinstance(value, Value) else value
        if isinstance(data, InCells):

            def of_part(data: Any, points: Points) -> Sampler:
                return points.sampler(data, "", shape, check)

            return self.joined(data.parts, of_part, shape, data.elsewhere)
        key, inside = dotted(*filter(None, (self.root, name))), self.of(self.cells)
        read: Sampler
        if isinstance(data, tuple):
            entries = [
                self.sampler(component, f"{name}.{index}".lstrip("."), shape[1:])
                for index, component in enumerate(data)
            ]

            def stacked() -> FloatArray:
                """The values of the entries, zero for those that are not given."""
                values = np.zeros((len(inside), *shape))
                for index, entry in enumerate(entries):
                    values[:, index] = entry()
                return values

            read = stacked
        elif isinstance(data, Expr) and not isinstance(data, fem.Constant):
            if data.ufl_shape != shape:
                raise InputError(f"has the shape {data.ufl_shape}; it must be {shape}", key)
            function = self.function(shape)
            expression = compiled.interpolation(data, function.function_space)

            def interpolated() -> FloatArray:
                function.interpolate(expression)
                values = self.values(function)[inside]
                self.refuse(np.isnan(values), "is not a number somewhere in the body", key)
                return values

            read = interpolated
        else:
            single = Value.of(value if isinstance(value, Value | str) else Value(data))
            read = partial(PresentValue(single, key, self.clock, shape), self.places[:, inside])
        if check is None:
            return read

        def checked() -> FloatArray:
            values = read()
            check(values, key)
            return values

        return checked

    def joined(
        self,
        parts: Sequence[Placed],
        of: Callable[[Any, Points], Sampler],
        shape: tuple[int, ...] = (),
        elsewhere: float = 0.0,
        adds: bool = False,
    ) -> Sampler:
        """Values (k, ...) by samplers ``of`` parts: in a cell those of its last part, or sums."""
        samplers = [(self.of(p.cells), of(p.content, self.for_key(p.key, p.cells))) for p in parts]

        def joined() -> FloatArray:
            values = np.full((len(self.all), *shape), elsewhere)
            for where, read in samplers:
                values[where] = values[where] + read() if adds else read()
            return values

        return joined

    def positive(
        self,
        value: Any,
        name: str,
        name_in_words: str = "the limit",
        sign: float = 1.0,
        over: FloatArray | float = 1.0,
    ) -> Sampler:
        """Limits ``sign M/over > 0``; collective.

        The sampler raises InputError for limits that are not positive.
        """

        def check(values: FloatArray, key: str) -> None:
            smallest = self.least(sign * values)
            if not smallest > 0.0:
                raise InputError(
                    f"{name_in_words} must be positive, so that the body without strain is inside "
                    f"of the set; it reaches {smallest:g}",
                    key,
                )
            if smallest < SMALLEST:
                message = f"{name_in_words} must be at least {SMALLEST:g}, it reaches {smallest:g}"
                raise InputError(message, key)

        read = self.sampler(value, name, check=check)

        def limits() -> FloatArray:
            with np.errstate(divide="ignore"):
                values = np.asarray(sign * read() / over)
            if np.ndim(over):
                check(sign * values, f"{self.root}.{name}")
            return values

        return limits

    def norm_set(
        self, name: str, limits: Sampler, always: bool = False, **made: Any
    ) -> list[Limited]:
        """``|L eps| <= M``, if any point of any rank has a limit, or ``always``; collective.

        ``made`` is for `NormSet`.
        """
        return self._where_any(limits, partial(NormSet, name, **made), always)

    def half_space(self, name: str, limits: Sampler, normal: Expr) -> list[Limited]:
        """``N : eps <= M`` with the ``normal`` N, if any point of any rank has a limit."""
        return self._where_any(limits, partial(HalfSpaceSet, name, normal=normal))

    def between(self, limit: Any, name: str, normal: Expr, root: float = 1.0) -> list[Limited]:
        """``m <= root N : eps <= M`` with ``at_least`` and ``at_most`` of a limit; collective."""
        upper = self.positive(limit.at_most, "at_most", over=root)
        lower = self.positive(limit.at_least, "at_least", "minus the lower limit", -1.0, root)
        return [
            *self.half_space(f"{name} at_most", upper, normal),
            *self.half_space(f"{name} at_least", lower, -normal),
        ]

    def _where_any(
        self, limits: Sampler, make: Callable[..., Any], always: bool = False
    ) -> list[Limited]:
        has_limit = always or on_any_rank(self.domain.comm, np.isfinite(limits()))
        return [Limited(self, limits, make)] if has_limit else []

    def refuse(self, marks: BoolArray, message: str, key: str) -> None:
        """Raise InputError if any point of any rank is marked; collective."""
        if on_any_rank(self.domain.comm, marks):
            raise InputError(message, key)

    def least(self, values: FloatArray) -> float:
        """The minimum over all ranks; NaN counts as -inf; collective."""
        return minimum(self.domain.comm, np.where(np.isnan(values), -np.inf, values))

    def largest(self, values: FloatArray) -> float:
        """The largest magnitude over all ranks; NaN counts as inf; collective."""
        return -self.least(-np.abs(values))


# A limit of some cells alone is none elsewhere; vectors and matrices are zero there.
_ELSEWHERE = {"at_most": math.inf, "at_least": -math.inf}


@dataclass(frozen=True)
class LimitsOnMesh:
    """All limits of a problem at the points of the strains.

    - ``ball``, ``others``: the ball of the paper, with M = inf by default, and the other sets
    - ``limit``, ``limit_at_peaks``: M of the ball in the space of strains, and where the strain of
      a cell is largest (`Element.at_peaks`)
    """

    points: Points
    ball: Limited
    others: Sequence[Limited]
    limit: fem.Function
    limit_at_peaks: fem.Function
    peaks: Sequence[tuple[Points, Sampler]] = ()

    @classmethod
    def of(cls, points: Points, placed: Sequence[Placed]) -> LimitsOnMesh:
        """The limits at the points; collective.

        Raises InputError for more than one ball, and for limits that are not positive.
        """
        # Limits that a body can have only once are joined over their cells.
        groups: dict[Any, list[Placed]] = {}
        for number, each in enumerate(placed):
            is_shared = each.cells is not None and each.content.once
            groups.setdefault(type(each.content) if is_shared else number, []).append(each)
        limits = [(group[0].key, _in_cells(group)) for group in groups.values()]
        balls = [(key, limit) for key, limit in limits if isinstance(limit, StrainBall)]
        if len(balls) > 1:
            raise InputError("has more than one StrainBall; use the smaller limit", balls[1][0])
        key, ball = balls[0] if balls else ("limits", StrainBall(Value(math.inf)))
        others = [
            limited
            for key, limit in limits
            if limit is not ball
            for limited in limit.on(points.for_key(key))
        ]
        (of_ball,) = ball.on(points.for_key(key))
        limit = at_peaks = points.function()
        peaks = []
        if points.element.at_peaks is not points.element:
            corners = Points(points.domain, points.element.at_peaks, points.clock)
            at_peaks = corners.function()
            limits_at_corners = corners.for_key(key).positive(
                ball.at_most, "at_most", "the locking limit"
            )
            peaks.append((corners, limits_at_corners))
        result = cls(points, of_ball, others, limit, at_peaks, peaks)
        result.write()
        return result

    def refresh(self) -> None:
        """Update all limits to the present values of the data; collective."""
        for limited in (self.ball, *self.others):
            limited.refresh()
        self.write()

    def write(self) -> None:
        """Write M of the ball into the functions; collective."""
        self.points.write(self.limit, self.ball.limits)
        for points, limits in self.peaks:
            points.write(self.limit_at_peaks, limits())


def _in_cells(group: Sequence[Placed]) -> Any:
    """The first limit of a group, with the values of all of them, each in its cells."""
    first, values = group[0].content, {}
    kind: type[StrainLimit] = type(first)
    for name in marked(kind, ScalarRule) if group[0].cells is not None else ():
        parts = [Placed(getattr(p.content, name), p.key_of(name), p.cells) for p in group]
        values[name] = Value(InCells(parts, _ELSEWHERE.get(name, 0.0)))
    return first.model_copy(update=values) if values else first
