"""The sections of a study file: keys with defaults, units, descriptions and checks.

The checks need no mesh, MPI or DOLFINx, so that a file is checked before anything is computed.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Self

from pydantic import (
    AfterValidator,
    Field,
    ModelWrapValidatorHandler,
    Tag,
    TypeAdapter,
    ValidationError,
    ValidationInfo,
    model_validator,
)

from contact_locking.contact.contact import Contact, Coulomb
from contact_locking.errors import InputError
from contact_locking.expressions import POSITION
from contact_locking.laws.limits import PenaltyParameters
from contact_locking.plain_text import nearest
from contact_locking.results.output import Extras, Output
from contact_locking.solver.settings import Adaptation, Settings, Steps
from contact_locking.study_file.parameters.problem import (
    LoadParameters,
    MaterialParameters,
    MeshParameters,
    name_faults,
)
from contact_locking.study_file.parameters.study import FitParameters, StudyParameters
from contact_locking.values.concept import (
    LIST,
    SECTION,
    BodyKind,
    Concept,
    Fault,
    FaultsError,
    Place,
    below,
    dimension_faults,
    dotted,
    entry,
    refuse_if,
    sections,
)
from contact_locking.values.kinds import (
    SCOPE,
    Count,
    Degree,
    File,
    Names,
    Number,
    Positive,
    Scope,
    Switch,
    Text,
    expressions,
    list_or,
)
from contact_locking.values.value import Tabulated, Value


class DiscretisationParameters(Concept):
    """The element: the degree of the displacements."""

    degree: Degree = entry(
        1, "degree of the displacements in each cell: 1, as in the theorems of the paper, or 2", "1"
    )


class EquilibriaParameters(Concept):
    """Several solutions of one problem with friction."""

    find: Count = entry(
        5,
        "the most solutions, including the first; the others are in folders equilibrium_2, ...",
        "1",
    )


class BranchesParameters(Concept):
    """A branch of solutions over a share of the friction coefficient or of loads.

    Over the friction coefficient it begins with none of it, over loads with those of the file.
    """

    over: Text = entry(
        "friction.coefficient",
        "what the share multiplies: friction.coefficient, loads (all of them, with prescribed "
        "displacements), or the key of some of them, such as loads.tractions.0.value",
    )
    to: Positive = entry(2.0, "the last share", "1")

    @property
    def is_over_friction(self) -> bool:
        return self.over == "friction.coefficient"


class SensitivityParameters(Concept):
    """How quantities of the solution change with numbers of the file, by its last tangent."""

    of: Names = entry(
        ("compliance",),
        "the quantities, such as contact_force.1, reactions.top.1, compliance or pressure_max",
    )
    to: Names = entry((), "the numbers, by their dotted keys, such as friction.coefficient")
    check: Switch = entry(
        False, "compare with central differences, which take two more solves for each number"
    )


class TableFile(Concept):
    """Two columns of a CSV file, interpolated linearly between the rows."""

    file: File = entry(..., "a CSV file with a row of column names, relative to the study file")
    over: Text = entry(..., "the name of the column with the ascending arguments")
    column: Text = entry(..., "the name of the column with the values")

    def table(self, name: str = "") -> Tabulated:
        """The table with its name.  Raises InputError for a file that cannot be used."""
        return Tabulated.read(self.file, self.over, self.column, name=name)

    def _faults(self) -> Iterator[Fault]:
        try:
            self.table()
        except InputError as error:
            yield Fault((error.key or "file",), str(error))


def _no_characters(value: Any, place: Place = ()) -> Iterator[Place]:
    """The places of the texts with half of a surrogate pair."""
    if isinstance(value, str) and any("\ud800" <= letter <= "\udfff" for letter in value):
        yield place
    items = value.items() if isinstance(value, dict) else ()
    for key, inner in enumerate(value) if isinstance(value, list | tuple) else items:
        yield from _no_characters(inner, (*place, key))


def _named(what: str) -> AfterValidator:
    """Refuses the names of tables or numbers, in words ``what``, that expressions cannot use."""

    def check(named: dict[str, Any]) -> dict[str, Any]:
        refuse_if(name_faults(named, what))
        return named

    return AfterValidator(check)


# Each section adds integrals to the forms, and compiling long forms takes long.
_MOST_CONTACTS = 100
_Several = Annotated[tuple[Contact, ...], Field(max_length=_MOST_CONTACTS), Tag(LIST)]
_OneOrSeveral = Annotated[Annotated[Contact, Tag(SECTION)] | _Several, list_or(SECTION)]


class Parameters(Concept):
    """A study file: the problem, the solver, the results, and the study of many cases if any."""

    title: Text = entry("", "what the study is about, for headings")
    parameters: Annotated[dict[str, Number], _named("names")] | None = entry(
        None,
        "numbers by names that expressions of the file may use, such as mu0 in 'mu0*exp(-s/s0)'",
    )
    mesh: MeshParameters = entry(MeshParameters(), "the body and its mesh")
    discretisation: DiscretisationParameters = entry(
        DiscretisationParameters(), "the element, and where it keeps the locking limit"
    )
    material: MaterialParameters = entry(MaterialParameters(), "the material (1)")
    loads: LoadParameters = entry(LoadParameters(), "loads and supports")
    contact: _OneOrSeveral = entry(
        Contact(),
        "unilateral contact (5): one section, or a list of sections, which have the keys "
        "contact.INDEX.on and so on",
    )
    friction: Coulomb = entry(Coulomb(), "Coulomb's friction (6)")
    steps: Steps | None = entry(
        None, "the times of a process, whose loads and gaps depend on t; null: one static problem"
    )
    tables: Annotated[dict[str, TableFile], _named("tables")] | None = entry(
        None,
        "tables of numbers, functions of one argument in expressions, such as ramp(t)",
    )
    penalty: PenaltyParameters = entry(PenaltyParameters(), "penalty parameters (25)")
    solver: Settings = entry(Settings(), "the nonlinear and linear solvers")
    adapt: Adaptation | None = entry(
        None, "meshes that are refined until the solution is accurate enough"
    )
    equilibria: EquilibriaParameters | None = entry(
        None, "other solutions of the same problem, which friction may have"
    )
    branches: BranchesParameters | None = entry(
        None,
        "a bifurcation diagram over the friction coefficient or loads, with its folds, in "
        "branches.csv and the report",
    )
    sensitivities: SensitivityParameters | None = entry(
        None, "derivatives of the results with respect to numbers of the file"
    )
    fit: FitParameters | None = entry(
        None, "measured curves that numbers of the file are fitted to"
    )
    study: StudyParameters | None = entry(None, "many cases with other values")
    certificate: Extras = entry(Extras(), "checks of the results that are made on demand")
    output: Output = entry(Output(), "the results")

    @model_validator(mode="wrap")
    @classmethod
    def _with_names(
        cls, data: Any, handler: ModelWrapValidatorHandler[Self], info: ValidationInfo
    ) -> Self:
        """Let the expressions below use the names of ``parameters`` and ``tables``."""
        keys, token = data if isinstance(data, dict) else {}, SCOPE.set(Scope())
        try:
            SCOPE.set(Scope(_numbers(keys.get("parameters")), _tables(keys, info.context)))
            return handler(data)
        except UnicodeEncodeError:
            # Pydantic cannot tell of a text that holds no character.
            place = next(_no_characters(data), ())
            message = "contains an escape that is no character"
            raise FaultsError([Fault(place, message)]) from None
        finally:
            SCOPE.reset(token)

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The parts of Gamma_C, each with its complete law of friction; empty without contact."""
        return tuple(
            section.over(self.friction, dotted(*place))
            for place, section in self._contact_sections()
            if section.on
        )

    @property
    def contact_names(self) -> tuple[str, ...]:
        """The names of all parts of Gamma_C, each once."""
        return tuple(dict.fromkeys(name for contact in self.contacts for name in contact.on))

    @property
    def refined_names(self) -> tuple[str, ...]:
        """The boundary parts of a builder that ``h_contact`` refines: Gamma_C, or what has it."""
        of_builder = () if self.mesh.geometry is None else self.mesh.geometry.facet_names
        others = [name for contact in self.contacts for name in contact.against or ()]
        names = [*self.contact_names, *others]
        return tuple(name for name in self._of_the_mesh(names) if name in of_builder)

    @property
    def touching(self) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
        """The boundary parts of the mesh that touch each other without shared nodes, in pairs."""
        return tuple(
            (self._of_the_mesh(contact.on), self._of_the_mesh(contact.against))
            for contact in self.contacts
            if contact.against
        )

    def _of_the_mesh(self, names: Sequence[str]) -> tuple[str, ...]:
        """The boundary parts of the mesh without ``mesh.parts`` that contain these parts."""
        parts = self.mesh.parts
        of_mesh = [
            facets for name in names for facets in (parts[name].on if name in parts else (name,))
        ]
        return tuple(dict.fromkeys(of_mesh))

    def shared_loads(self) -> Iterator[tuple[str, Value]]:
        """The key and the value of each load that ``branches`` multiplies."""
        over = "" if self.branches is None else self.branches.over
        for key, value in self.loads.numbers():
            if key == over or key.startswith(f"{over}."):
                yield key, value

    def check_dimension(self, dim: int) -> None:
        """Raise InputError for the first value that does not fit a body of ``dim`` dimensions."""
        for fault in itertools.chain(self._dimension_faults(dim), self._faults_of_expressions(dim)):
            raise InputError(fault.message, dotted(*fault.place))

    def _faults(self) -> Iterator[Fault]:
        named = [
            (place, contact.name) for place, contact in self._contact_sections() if contact.name
        ]
        for number, (place, name) in enumerate(named):
            if name in [other for _, other in named[:number]]:
                yield Fault((*place, "name"), f"'{name}' is the name of another contact")
        if self.output.charts and self.steps is None:
            message = "are of the steps of a process, and the file has no steps; leave them out"
            yield Fault(("output", "charts"), message)
        over_loads = self.branches is not None and not self.branches.is_over_friction
        if over_loads and not any(self.shared_loads()):
            yield Fault(
                ("branches", "over"),
                "names no load; use friction.coefficient, loads, or the key of a load, such as "
                "loads.tractions.0.value",
            )
        if self.sensitivities is not None and not self.sensitivities.to:
            yield Fault(("sensitivities", "to"), "name numbers, such as [friction.coefficient]")
        for place, go_together, other in self._pairs():
            if go_together:
                yield Fault(place, f"does not go with {other}; leave out one of the two")
        for name in set(self.tables or ()) & set(self.parameters or ()):
            yield Fault(("parameters", name), "is the name of a table as well")
        yield from self._faults_of_expressions(self.mesh.dim)
        if self.study is not None:
            yield from below(("study",), self.study.key_faults(type(self)))
        if self.mesh.dim is not None:
            yield from self._dimension_faults(self.mesh.dim)
            yield from self._name_faults()

    def _pairs(self) -> Iterator[tuple[Place, bool, str]]:
        """Sections that exclude each other: of the first the place, and the second with the reason.

        The second entry says whether both are there.
        """
        adapts, has_steps = self.adapt is not None, self.steps is not None
        derived = self.sensitivities is not None
        memory = "steps, whose friction remembers the slip on one mesh"
        yield ("adapt",), adapts and has_steps, memory
        changing = "adapt, whose meshes change with the numbers"
        checks = self.sensitivities is not None and self.sensitivities.check
        yield ("sensitivities", "check"), adapts and checks, changing
        yield ("fit",), adapts and self.fit is not None, changing
        for section in ("equilibria", "branches"):
            for name, is_there in (("steps", has_steps), ("adapt", adapts)):
                both = is_there and getattr(self, section) is not None
                yield (section,), both, f"{name}: other solutions are those of one problem"
        facing = "sensitivities, as derivatives do not see which points face each other"
        for place, contact in self._contact_sections():
            turns = contact.against is not None and contact.pair != "once"
            yield (*place, "pair"), derived and turns, f"{facing}: take once"

    def _contact_sections(self) -> list[tuple[Place, Contact]]:
        if isinstance(self.contact, tuple):
            return [(("contact", index), entry) for index, entry in enumerate(self.contact)]
        return [(("contact",), self.contact)]

    def _name_faults(self) -> Iterator[Fault]:
        """Names that the builder does not give; names of a mesh file are checked with the mesh."""
        cells, facets = self.mesh.geometry.cell_names, self.mesh.facet_names
        for name in self.material.regions:
            yield from _unknown_name(("material", "regions", name), name, cells, "the body")
        parts = {"material": (cells, "the body"), "loads": (facets, "the boundary")}
        parts["contact"] = parts["loads"]
        for place, section in sections(self):
            keys = {"on", "against"}.intersection(type(section).model_fields)
            for key in sorted(keys) if place and place[0] in parts else ():
                for name in getattr(section, key) or ():
                    yield from _unknown_name((*place, key), name, *parts[str(place[0])])

    def _dimension_faults(self, dim: int) -> Iterator[Fault]:
        is_sheet = self.material.plane == "stress"
        yield from dimension_faults(self, BodyKind(dim, self.mesh.axisymmetric, is_sheet))

    def _faults_of_expressions(self, dim: int | None) -> Iterator[Fault]:
        """Coordinates that there are not in ``dim`` dimensions, and t without steps."""
        outside = () if dim is None else POSITION[dim:]
        for place, value, rule in expressions(self):
            assert value.expression is not None
            for name in sorted(value.expression.names.intersection(outside)):
                known = [known for known in rule.variables if known not in outside]
                fault = f"unknown name '{name}'{nearest(name, known)}; known: {', '.join(known)}"
                yield Fault(place, f"in the expression '{value}': {fault} in {dim}D")
            if self.steps is None and value.is_timed:
                yield Fault(
                    place,
                    "depends on the time t, and the file has no steps; add a section such as "
                    "steps: {to: 1, count: 20}",
                )


def _numbers(section: Any) -> dict[str, float]:
    """The numbers of ``parameters`` that are some; the others are faults of their own."""
    numbers = {}
    for name, value in section.items() if isinstance(section, dict) else ():
        with contextlib.suppress(ValidationError):
            numbers[str(name)] = _NUMBER.validate_python(value)
    return numbers


def _tables(data: Any, folder: Any) -> dict[str, Tabulated]:
    """The tables that can be read; others are zero, and faults of their own."""
    sections = data.get("tables")
    tables = {}
    for name, section in sections.items() if isinstance(sections, dict) else ():
        tables[str(name)] = Tabulated([0.0, 1.0], [0.0, 0.0])
        with contextlib.suppress(ValidationError):
            tables[str(name)] = TableFile.model_validate(section, context=folder).table(name)
    return tables


_NUMBER = TypeAdapter(Number)


def _unknown_name(place: Place, name: str, known: Sequence[str], what: str) -> Iterator[Fault]:
    if name not in known:
        message = f"no part of {what} is named '{name}'{nearest(name, known)}"
        yield Fault(place, f"{message}; there are {', '.join(known)}")
