"""An estimate of the memory and the time of a solve, before anything is solved.

The estimate is ``tangents x seconds of a tangent`` for the unknowns N of the mesh.  The number of
tangents hardly depends on the mesh and on n, and the time and the memory of a tangent grow with N
as measured (`reference`).  A solve that locks everywhere, or one with friction that hardly settles,
takes more tangents, which is not known before the solve.  docs/guides/large.md has measured times
beside the estimate, which are within a factor of 3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from mpi4py import MPI

from contact_locking.costs import probe
from contact_locking.costs.factorised import FILTER_LIMIT, MODERATE_CONTRAST, chosen
from contact_locking.costs.reference import REFERENCE, Reference
from contact_locking.parallel import minimum
from contact_locking.parameters import Parameters
from contact_locking.plain_text import count, duration, gigabytes

Beside = Literal["filter", "projection", "nothing"]


@dataclass(frozen=True)
class Workload:
    """The data of a solve that its cost depends on.

    ``unknowns`` are those of the displacement.  ``tangents`` are the matrices of all
    ``steps`` together; a static problem is one step.  ``factor`` is the number of rows that each
    tangent factorises, by the direct solver or beside GMRES.  ``beside`` helps GMRES where cells
    lock: the filter, or the projection where more is locked than the filter takes, or neither where
    n bounds the contrast.
    """

    dim: int
    unknowns: int
    ranks: int
    is_direct: bool
    beside: Beside
    factor: float
    tangents: float
    steps: int = 1


@dataclass(frozen=True)
class Estimate:
    """Bytes of all ``ranks`` together, and seconds by the clock with a core for each rank.

    ``kind`` is "at most" for adapted meshes, which may end earlier, and "at least" for sizes beyond
    what has been measured.
    """

    memory: float
    seconds: float
    ranks: int
    kind: Literal["about", "at most", "at least"] = "about"


def completed(
    facts: Mapping[str, Any], parameters: Parameters, comm: MPI.Intracomm
) -> dict[str, Any]:
    """The facts about an assembled problem with the ``estimate`` for this machine; collective.

    A warning is added if the estimate is more than the memory of a machine of these ranks.
    """
    facts = dict(facts)
    compact = facts.pop("compact dofs")
    load = workload(parameters, facts["dimension"], facts["dofs"], comm.size, compact=compact)
    slowest = minimum(comm, probe.speed())
    found = replace(estimate(load, slowest), kind=_kind(parameters, load))
    warnings = [*facts["warnings"], *_warnings(found, comm)]
    return {**facts, "estimate": found, "warnings": warnings}


def rows(expected: Estimate) -> list[tuple[str, str]]:
    """The estimate in words."""
    about = "about" if expected.kind == "about" else f"{expected.kind} about"
    precision = ", within a factor of 3" if expected.kind == "about" else ""
    ranks = count(expected.ranks, "rank")
    return [
        ("estimated memory", f"{about} {gigabytes(expected.memory)} in all, on {ranks}"),
        ("estimated time", f"{about} {duration(expected.seconds)}{precision}"),
    ]


def _kind(parameters: Parameters, load: Workload) -> Literal["about", "at most", "at least"]:
    if parameters.adapt is not None:
        return "at most"
    is_measured = load.is_direct or load.unknowns <= REFERENCE.largest
    return "about" if is_measured else "at least"


def _warnings(expected: Estimate, comm: MPI.Intracomm) -> list[str]:
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    share, there = expected.memory * node.size / comm.size, probe.memory()
    node.Free()
    lacking = None if there is None or share <= there else (share, there)
    found = [pair for pair in comm.allgather(lacking) if pair is not None]
    if not found:
        return []
    needed, present = max(found)
    return [
        f"the solve would need about {gigabytes(needed)} of memory, by an estimate, and this "
        f"machine has {gigabytes(present)}; take a coarser mesh, a fine mesh at the contact "
        "only (with a builder mesh.h and mesh.h_contact), or several machines"
    ]


def workload(
    parameters: Parameters,
    dim: int,
    unknowns: int,
    ranks: int,
    reference: Reference = REFERENCE,
    compact: int | None = None,
) -> Workload:
    """What a run of the study file's base case has to do on a mesh with so many unknowns.

    ``compact`` are those of a cube that takes as long to factorise, by default all of them.
    Adapted meshes are taken to grow to the most unknowns that the study file allows.
    """
    times = _times(parameters, reference)
    if parameters.adapt is not None:
        unknowns, times = max(unknowns, parameters.adapt.max_dofs), 2.0 * times
        compact = None
    compact = unknowns if compact is None else compact
    is_direct = chosen(parameters.solver.linear, dim, compact) == "direct"
    limit = FILTER_LIMIT[dim, parameters.discretisation.degree]
    filtered = reference.filtered * unknowns
    if not _limits_strain(parameters):
        # Nothing but the nodes of a side, at most.
        filtered = dim * (unknowns / dim) ** (1.0 - 1.0 / dim)
    beside: Beside = "filter"
    if not is_direct and dim == 3 and filtered > limit:
        beside = "nothing" if _bounds_contrast(parameters) else "projection"
    beside_gmres = {
        "filter": min(filtered, limit),
        "projection": reference.projected * unknowns,
        "nothing": 0.0,
    }
    steps = 1 if parameters.steps is None else len(parameters.steps.planned)
    return Workload(
        dim=dim,
        unknowns=unknowns,
        ranks=ranks,
        is_direct=is_direct,
        beside=beside,
        factor=compact if is_direct else beside_gmres[beside],
        tangents=times * (reference.tangents + (steps - 1) * reference.tangents_of_step),
        steps=steps,
    )


def _times(parameters: Parameters, reference: Reference) -> float:
    """The tangents of this solver and problem, relative to those of the reference."""
    has_limit = _limits_strain(parameters)
    if not has_limit and not parameters.contacts:
        return reference.linear
    simple = 1.0 if has_limit and parameters.contacts else reference.simple
    nests = parameters.solver.friction == "nested" and parameters.contacts
    more = 1.0 if parameters.certificate.limit else 0.0
    return simple * ((reference.nested if nests else 1.0) + more)


def _limits_strain(parameters: Parameters) -> bool:
    material = parameters.material
    return bool(material.limits) or any(region.limits for region in material.regions.values())


def _bounds_contrast(parameters: Parameters) -> bool:
    """Whether n keeps every cell so soft that multigrid does without projection.

    Of a stiffness that is no number for Young's modulus nothing is known here.
    """
    young = parameters.material.elasticity.young
    return isinstance(young, float) and parameters.penalty.n <= MODERATE_CONTRAST * young


def estimate(load: Workload, speed: float = 1.0, reference: Reference = REFERENCE) -> Estimate:
    """The estimate for a machine that is ``speed`` times as fast as that of the reference."""
    large = load.tangents * _tangent(load, reference) / _speed_up(load, reference)
    small = reference.start + load.steps * reference.step + load.tangents * reference.tangent
    return Estimate(_memory(load, reference), (small + large) / speed, load.ranks)


def _tangent(load: Workload, reference: Reference) -> float:
    """The seconds of one tangent on one rank, as far as they grow with the unknowns."""
    flat = load.dim == 2
    direct = reference.direct_2d if flat else reference.direct_3d
    if load.is_direct:
        return direct.linear * load.unknowns + replace(direct, linear=0.0)(load.factor)
    if load.beside == "projection":
        return reference.projected_3d(load.unknowns)
    if load.beside == "nothing":
        return reference.alone_3d(load.unknowns)
    iterative = reference.iterative_2d if flat else reference.iterative_3d
    factorised = replace(direct, linear=0.0)(load.factor)
    return reference.set_up + iterative(load.unknowns) + factorised


def _speed_up(load: Workload, reference: Reference) -> float:
    ranks = min(load.ranks, reference.direct_ranks) if load.is_direct else load.ranks
    return ranks * (reference.efficiency if ranks > 1 else 1.0)


def _memory(load: Workload, reference: Reference) -> float:
    flat = load.dim == 2
    of_unknowns = (reference.memory_2d if flat else reference.memory_3d)(load.unknowns)
    factor = (reference.factor_2d if flat else reference.factor_3d)(load.factor)
    pieces = reference.in_pieces if load.ranks > 1 else 1.0
    kept = reference.kept_alone * load.unknowns if load.beside == "nothing" else 0.0
    return load.ranks * reference.rank + of_unknowns + pieces * factor + kept
