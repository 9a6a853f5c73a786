"""Solved states in files, by adios4dolfinx or io4dolfinx, and restarts from them.

The order of the stored values is the order of the mesh from Gmsh, which does not depend on the
distribution.  The coordinates of the nodes are stored as well: the fields belong to a mesh with the
same coordinates.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from dolfinx import fem
from mpi4py import MPI
from pydantic import BaseModel, ValidationError

from contact_locking import _compat
from contact_locking._version import __version__
from contact_locking.arrays import FloatArray
from contact_locking.certificate.solved_state import SolvedState
from contact_locking.certificate.verdict import is_solved
from contact_locking.errors import ContactLockingError, InputError
from contact_locking.fem.compiled import Kept
from contact_locking.files.readable import file_digest
from contact_locking.laws.penalty import Penalty
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.sources import WholeMesh, gather_mesh, spread
from contact_locking.parallel import maximum, on_every_rank, on_root
from contact_locking.problem.discrete_problem import DiscreteProblem
from contact_locking.process.problem_solver import ProblemSolver
from contact_locking.process.saved_steps import saved_steps
from contact_locking.results.contact_points import OPEN
from contact_locking.results.folder import CHECKPOINT, HISTORY, RECORD
from contact_locking.results.solution import Solution
from contact_locking.results.table import Table
from contact_locking.solver.multipliers import ContactForces, Multipliers, multiplier_spaces
from contact_locking.solver.task import Counts, Outcome, SavedState, SolverReport

_DISPLACEMENT, _PLACES = "old_displacement", "places"
# The bytes of the record and of the metadata of ADIOS2.
_NOTES = 65_536


@dataclass(frozen=True)
class SavedStep:
    """A step that was solved and saved.

    ``memories`` are what friction remembered during the step: for each contact ``u_{k-1,tau}``
    (k, d) and the slip ``s_{k-1}`` (k,).  ``displacement`` are the local values of ``u_{k-1}``,
    None unless bodies are paired anew.  ``history`` ends with the row of the step, and ``halved``
    tells which steps were halved.
    """

    time: float
    memories: tuple[tuple[FloatArray, FloatArray], ...]
    displacement: FloatArray | None
    history: Table
    halved: tuple[str, ...]


@dataclass(frozen=True)
class Checkpoint:
    """A saved state on the present mesh.

    ``bounds`` are the friction bounds (k,) of the contacts.  If the contacts or the sets of strains
    of the checkpoint are not those of the problem, ``multipliers`` is None and ``bounds`` is empty.
    ``converged`` says that the state is a solution, and ``problem`` of which: the fingerprint of
    mesh, material, loads, contact, friction and penalty in a study file, empty for a script.
    ``step`` is None for a state that is no step of a process.
    """

    state: SavedState
    multipliers: Multipliers | None
    bounds: tuple[FloatArray, ...]
    problem: str
    converged: bool
    step: SavedStep | None

    def solved_again(self, solver: ProblemSolver) -> SolverReport | None:
        """The report if the state meets the criteria of a solution, otherwise None; collective."""
        state = self.restored(solver)
        if is_solved(state):
            return state.report
        solver.system.clear()
        return None

    def restored(self, solver: ProblemSolver) -> SolvedState:
        """The saved state in place of what the solver would find; collective."""
        contacts, counts = solver.problem.contacts, Counts()
        self.state.enter(solver.system)
        # The travel of a foundation, which is part of the state, changes what slips refer to.
        if (step := self.step) is not None:
            for contact, (place, slip) in zip(contacts, step.memories, strict=True):
                contact.recall(place, slip, step.displacement)
            row = step.history.rows[-1]
            counts = Counts(int(row["tangents"]), int(row["linear"]))
        solver.system.bounds.enter(contacts, self.bounds)
        outcome = Outcome(self.multipliers)
        return solver.state(SolverReport.solved(outcome, counts, from_saved=True))


class _Reader:
    """The stored fields in a folder, on the mesh of a problem; all methods are collective."""

    def __init__(self, folder: Path, problem: DiscreteProblem) -> None:
        self.folder, self._contacts, self._dim = folder, problem.contacts, problem.domain.dim

    def field(self, name: str, space: fem.FunctionSpace) -> fem.Function:
        function = fem.Function(space, name=name)
        _compat.load_function(self.folder, function, name)
        return function

    def scalars(self, name: str, number: int) -> FloatArray:
        """The values (k,) on a contact."""
        surface = self._contacts[number].surface
        return self.field(f"{name}_{number}", surface.scalar_space).x.array[surface.nodes]

    def vectors(self, name: str, number: int) -> FloatArray:
        """The values (k, d) on a contact."""
        surface = self._contacts[number].surface
        values = self.field(f"{name}_{number}", surface.vector_space).x.array
        return values.reshape(-1, self._dim)[surface.blocks]


# The coordinates of the same mesh may differ by this share of the extent, because another machine
# may have made the mesh.
_SAME_PLACE = 1e-9


def places(space: fem.FunctionSpace) -> fem.Function:
    """The coordinates x as a function; collective."""
    found = fem.Function(space)
    dim = space.mesh.geometry.dim
    found.interpolate(lambda x: x[:dim])
    return found


def _size_of(domain: Domain, u: fem.Function) -> tuple[int, ...]:
    """The entry ``size`` of a record."""
    space, shape = u.function_space, int(domain.axisymmetric)
    nodes, degree = int(space.dofmap.index_map.size_global), space.element.basix_element.degree
    return domain.dim, domain.num_cells, nodes, degree, shape


def _require_same_mesh(record: Record, problem: DiscreteProblem, fields: _Reader) -> None:
    """Raise InputError for a state of another mesh or element; collective."""
    space, domain = problem.u.function_space, problem.domain
    is_same = record.size == _size_of(domain, problem.u)
    if is_same:
        # Another version of Gmsh makes another mesh of the same parameters.
        expected = places(space).x.array
        away = np.abs(fields.field(_PLACES, space).x.array - expected)
        extent = maximum(domain.comm, np.abs(expected))
        is_same = on_every_rank(domain.comm, away <= _SAME_PLACE * extent)
    if not is_same:
        is_adapted = record.is_refined and not domain.is_refined
        hint = ", which was refined: add the section adapt" if is_adapted else ""
        raise InputError(
            f"the checkpoint in {fields.folder} is of another mesh or element; restart with mesh "
            f"and discretisation.degree of the run that saved it{hint}"
        )


def refined_mesh(directory: str | Path | None, comm: MPI.Intracomm) -> Domain | None:
    """The refined mesh that the last checkpoint of a run belongs to; collective.

    None for the mesh of a study, and without a run.  Raises InputError if the checkpoint is
    missing, damaged or of another format, and ContactLockingError if the library is missing.
    """
    if directory is None:
        return None
    place = saved_steps(Path(directory))[-1]
    expect(place, comm)
    held: list[WholeMesh] = []

    def load() -> bool:
        record, _ = load_fields(place)
        folder = locate(place)
        if record.is_refined:
            held.append(WholeMesh.load(folder, MESH))
        return bool(held)

    return spread(next(iter(held), None), comm) if on_root(comm, load) else None


def unavailable() -> str | None:
    """The reason why no checkpoint can be written or read here, otherwise None."""
    try:
        _compat.checkpoint_library()
    except ImportError as error:
        return (
            f"checkpoints take adios4dolfinx, which cannot be imported here ({error}); Debian has "
            "it as python3-adios4dolfinx, conda-forge as adios4dolfinx, or pip install io4dolfinx"
        )
    return None


def is_possible(domain: Domain) -> bool:
    """Whether the library is there, and each rank has cells, which it takes for granted."""
    cells = domain.mesh.topology.index_map(domain.dim).size_local
    return unavailable() is None and on_every_rank(domain.comm, cells > 0)


def size(solution: Solution) -> int:
    """The bytes that :func:`write` needs: the values, and the dofs of each cell; collective."""
    total = _NOTES
    for function in _fields(solution).values():
        dofmap, mesh = function.function_space.dofmap, function.function_space.mesh
        cells = mesh.topology.index_map(mesh.topology.dim).size_global
        total += 8 * dofmap.index_map.size_global * dofmap.index_map_bs
        total += cells * (8 * dofmap.bs * dofmap.list.shape[1] + 12)
    domain = solution.domain
    if domain.is_refined:
        # Points, cells, facets and parts.
        total += domain.num_cells * (16 * (domain.dim + 2) + 8 * domain.dim + 4)
    return int(total)


def write(solution: Solution, folder: Path) -> None:
    """Write a checkpoint into an existing folder with enough room; collective.

    Raises ContactLockingError if the library is missing, a rank has no cells or a file cannot be
    written.
    """
    _require_library()
    domain = solution.domain
    _require_cells(domain)
    _compat.prepare_communicator(domain.comm)
    try:
        for name, function in _fields(solution).items():
            _compat.save_function(folder / FIELDS, function, name)
    except RuntimeError as error:
        if domain.comm.size > 1:
            # The other ranks may wait inside ADIOS2, where no error reaches them.
            raise
        # In one line, without the escape sequences that ADIOS2 adds for terminals.
        told = " ".join(re.sub(r"\x1b\[[\d;]*m", "", str(error)).split())
        raise ContactLockingError(f"ADIOS2 cannot write it: {told}") from error
    penalties = solution.summary["penalty"]
    mesh = gather_mesh(domain) if domain.is_refined else None

    def finish() -> None:
        if mesh is not None:
            mesh.save(folder, MESH)
        record = Record(
            converged=solution.converged,
            n=penalties["n"],
            epsilon=penalties["epsilon"],
            regularisations=tuple(fields.regularisation for fields in solution.contacts),
            size=_size_of(domain, solution.displacement),
            is_refined=domain.is_refined,
            contacts=len(solution.contacts),
            strain_sets=len(solution.locking_parts),
            problem=solution.problem,
            step=_about_step(solution),
            travels=solution.state.saved.travels,
        )
        if solution.history.rows:
            (folder / HISTORY).write_text(solution.history.text(), encoding="utf-8")
        save(record, folder)

    on_root(domain.comm, finish)


def expect(directory: str | Path, comm: MPI.Intracomm) -> None:
    """Raise the errors of :func:`read` that need neither mesh nor fields; collective."""
    on_root(comm, lambda: load(directory))
    _require_library()


def read(directory: str | Path, problem: DiscreteProblem) -> Checkpoint:
    """The saved state of a run's folder, on the mesh of ``problem``; collective.

    Raises InputError if the checkpoint is missing, damaged, of another mesh or of another format,
    and ContactLockingError if the library is missing or a rank has no cells.
    """
    comm = problem.domain.comm
    expect(directory, comm)
    _require_cells(problem.domain)
    record, path = on_root(comm, lambda: load_fields(directory))
    _compat.prepare_communicator(comm)
    fields = _Reader(path, problem)
    _require_same_mesh(record, problem, fields)
    multipliers: Multipliers | None = None
    bounds: tuple[FloatArray, ...] = ()
    same_contacts = record.contacts == len(problem.contacts) or not problem.contacts
    if same_contacts and record.strain_sets == len(problem.data.sets):
        multipliers, bounds = _load_multipliers(fields, problem)
    pressures = () if multipliers is None else tuple(c.pressure for c in multipliers.contacts)
    displacement = fields.field("displacement", problem.u.function_space).x.array
    penalty = Penalty(record.n, record.epsilon, record.regularisations)
    state = SavedState(displacement, pressures, penalty, travels=record.travels)
    step = None
    if record.step is not None and multipliers is not None:
        step = _load_step(record.step, locate(directory), problem, fields)
    return Checkpoint(state, multipliers, bounds, record.problem, record.converged, step)


def _load_multipliers(
    fields: _Reader, problem: DiscreteProblem
) -> tuple[Multipliers, tuple[FloatArray, ...]]:
    """The multipliers and the friction bound (k,) of each contact; collective."""
    forces, bounds = [], []
    for number in range(len(problem.contacts)):
        pressure, state, bound = (
            fields.scalars(name, number)
            for name in ("contact_pressure", "contact_state", "friction_bound")
        )
        friction = 0.0 - fields.vectors("tangential_traction", number)
        forces.append(ContactForces(pressure, friction, state != OPEN))
        bounds.append(bound)
    spaces = multiplier_spaces(problem.data, Kept(), problem.domain.mesh)
    found = Multipliers.none(problem.data, spaces, tuple(forces))
    for name, part in zip(_names_of_parts(len(found.parts)), found.parts, strict=True):
        part.x.array[:] = fields.field(name, part.function_space).x.array
    found.add_up(problem.data)
    return found, tuple(bounds)


def _load_step(
    entry: Mapping[str, Any], folder: Path, problem: DiscreteProblem, fields: _Reader
) -> SavedStep:
    """The step with this entry in a record; collective.  Raises InputError for its history."""
    memories = [
        (fields.vectors("old_place", number), fields.scalars("old_slip", number))
        for number in range(len(problem.contacts))
    ]
    displacement = None
    if "paired_at" in entry:
        displacement = fields.field(_DISPLACEMENT, problem.u.function_space).x.array

    def history() -> Table:
        path = folder / HISTORY
        return Table.read(path.read_text(encoding="utf-8"), str(path))

    return SavedStep(
        time=float(entry["time"]),
        memories=tuple(memories),
        displacement=displacement,
        history=on_root(problem.domain.comm, history),
        halved=tuple(map(str, entry["halved"])),
    )


def _names_of_parts(sets: int) -> list[str]:
    """The names of the stored multipliers of the sets of strains."""
    return ["locking_stress"] + [f"locking_stress_{number}" for number in range(1, sets)]


def _about_step(solution: Solution) -> dict[str, Any] | None:
    """The entry of the record about the step; None for a problem without steps."""
    if not solution.history.rows:
        return None
    is_paired = any(contact.paired_at is not None for contact in solution.contacts)
    paired = {"paired_at": _DISPLACEMENT} if is_paired else {}
    return {"time": solution.time, "halved": list(solution.halved), **paired}


def _fields(solution: Solution) -> dict[str, fem.Function]:
    """The stored fields by name; in a step, with what friction remembered in it; collective."""
    found = {"displacement": solution.displacement}
    found |= zip(_names_of_parts(len(solution.locking_parts)), solution.locking_parts, strict=True)
    found[_PLACES] = places(solution.displacement.function_space)
    for number, contact in enumerate(solution.contacts):
        surface = contact.surface
        scalars = {
            "contact_pressure": contact.pressure,
            "contact_state": contact.state.astype(float),
            "friction_bound": contact.bound,
        }
        vectors = {"tangential_traction": contact.traction}
        if solution.history.rows:
            scalars["old_slip"], vectors["old_place"] = contact.old_slip, contact.old_place
            if contact.paired_at is not None:
                found[_DISPLACEMENT] = fem.Function(surface.vector_space)
                found[_DISPLACEMENT].x.array[:] = contact.paired_at
        found |= {f"{name}_{number}": surface.scalar_function(v) for name, v in scalars.items()}
        found |= {f"{name}_{number}": surface.vector_function(v) for name, v in vectors.items()}
    return found


def _require_cells(domain: Domain) -> None:
    if not is_possible(domain):
        raise ContactLockingError(
            "the mesh has so few cells that a rank has none, which checkpoints cannot have; take "
            "fewer ranks"
        )


def _require_library() -> None:
    reason = unavailable()
    if reason is not None:
        raise ContactLockingError(reason)


def start_in_words(directory: str | Path, report: SolverReport) -> str:
    """How a solve has used the state that was saved in a folder, in words."""
    if not report.from_saved:
        return f"from nothing, as the state in {directory} is too far away"
    if report.tangents == 0:
        return f"the state in {directory} meets every criterion, nothing was left to do"
    return f"from the state in {directory}"


def saved_step(path: Path, problem: DiscreteProblem) -> tuple[Checkpoint, SavedStep]:
    """The checkpoint of a step in ``path``; collective.

    Raises InputError for a checkpoint that is not of a converged step with these contacts, and the
    errors of :func:`read`.
    """
    saved = read(path, problem)
    if saved.step is None or not saved.converged:
        raise InputError(
            f"{path} is no checkpoint of a step that has converged, with the same contacts; a "
            "process starts from the last step of a process"
        )
    return saved, saved.step


# A change of the written files raises this number.
FORMAT = 7
# The names in the folder of a checkpoint.
FIELDS, MESH = "state.bp", "mesh"
_AGAIN = "save it again with contact-locking run --checkpoint"


class Record(BaseModel):
    """Identifies the problem and the mesh that a checkpoint belongs to.

    ``size`` has the dimension, the cells and the nodes of the mesh, the degree of the displacement,
    and 1 for a body of revolution; ``is_refined`` that of the mesh.  ``problem`` is the fingerprint
    of everything that defines the solution.  ``contacts`` is the number of contacts,
    ``strain_sets`` that of the sets of strains, and ``regularisations`` has one length for each
    contact.  ``travels`` are those of the tools.  ``step`` is about the step of a process, None for
    a problem without steps.  ``files`` has the digest of each file.
    """

    # JSON has no infinity, which is a text.
    model_config = {"frozen": True, "ser_json_inf_nan": "strings"}

    format: int = FORMAT
    version: str = __version__
    converged: bool
    n: float
    epsilon: float
    regularisations: tuple[float, ...]
    size: tuple[int, ...]
    is_refined: bool
    contacts: int
    strain_sets: int
    problem: str
    step: dict[str, Any] | None = None
    travels: tuple[float, ...] = ()
    files: dict[str, str] = {}


def save(record: Record, folder: Path) -> None:
    """Write the record of a checkpoint whose fields are complete.  Raises OSError."""
    for path in (folder / FIELDS).glob("profiling*"):
        path.unlink()  # timings of ADIOS2, which differ from run to run
    # The files of the fields, and of a refined mesh.
    paths = [*sorted((folder / FIELDS).iterdir()), *sorted(folder.glob(f"{MESH}.*"))]
    files = {path.name: file_digest(str(path)) for path in paths}
    whole = record.model_copy(update={"files": files})
    text = whole.model_dump_json(indent=2, exclude_none=True)
    (folder / RECORD).write_text(f"{text}\n", encoding="utf-8")


def locate(directory: str | Path) -> Path:
    """The folder of the checkpoint: ``directory`` itself, or in the folder of a run."""
    given = Path(directory)
    return given if (given / RECORD).is_file() else given / CHECKPOINT


def load(directory: str | Path) -> Record:
    """The record.

    Raises InputError for a missing, damaged or other record, and OSError if it cannot be read.
    """
    path = locate(directory) / RECORD
    if not path.is_file():
        raise InputError(f"there is no checkpoint in {directory}; {_AGAIN}")
    try:
        record = Record.model_validate_json(path.read_bytes())
    except ValidationError:
        record = None
    if record is None or record.format != FORMAT:
        raise InputError(
            f"{path} is damaged, or was saved by another version than contact_locking "
            f"{__version__}; {_AGAIN}"
        )
    return record


def load_fields(directory: str | Path) -> tuple[Record, Path]:
    """The record and the folder of the fields, whose files are complete and unchanged.

    Reads all files for their digests.  Raises as `load`.
    """
    record, folder = load(directory), locate(directory)
    for name, digest in record.files.items():
        path = (folder if Path(name).stem == MESH else folder / FIELDS) / Path(name).name
        if not path.is_file() or file_digest(str(path)) != digest:
            raise InputError(f"{path} is missing or damaged; {_AGAIN}")
    return record, folder / FIELDS
