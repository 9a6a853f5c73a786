"""An estimate of the memory of a solve, before anything is solved.

Every rank takes memory for the libraries, every unknown for the fields and matrices, and the factor
of the rows that are factorised takes most of the rest.  The estimate
cannot foresee how much of the body locks; docs/guides/large.md compares it with measurements.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from mpi4py import MPI

from contact_locking.plain_text import count, gigabytes
from contact_locking.solver.linear.factorised import FILTER_LIMIT, MODERATE_CONTRAST, chosen
from contact_locking.study_file.parameters import Parameters

# Bytes, measured with DOLFINx 0.9, OpenBLAS and CHOLMOD: of a rank with all libraries, of an
# unknown by dimension, with and without limits of the strain, and coefficient and power of the
# factor in its rows.
_RANK, _UNKNOWN, _ELASTIC = 0.23e9, {2: 1.6e3, 3: 6.9e3}, {2: 1.6e3, 3: 5.5e3}
_FACTOR = {2: (1.6e3, 1.0), 3: (145.0, 4 / 3)}
# The factor in pieces on several ranks, relative to that on one rank.
_IN_PIECES = 2.0
# More bytes of an unknown where multigrid works alone: GMRES has a vector for each iteration.
_ALONE = 3.0e3
# The rows of the filter beside GMRES, and of the projection that takes the place of a filter that
# is too large, over the unknowns.
_FILTERED, _PROJECTED = 0.65, 0.36
# The largest iterative solve that was measured, in unknowns.
_LARGEST = 8.3e5
# Where a container limits its memory, by the version of control groups.
_LIMITS = ("/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes")


@dataclass(frozen=True)
class Estimate:
    """Bytes of all ``ranks`` together.

    ``kind`` is "at most" for adapted meshes, which may end earlier, and "at least" for sizes beyond
    what has been measured.
    """

    memory: float
    ranks: int
    kind: Literal["about", "at most", "at least"] = "about"

    def words(self) -> str:
        about = "about" if self.kind == "about" else f"{self.kind} about"
        return f"{about} {gigabytes(self.memory)} in all, on {count(self.ranks, 'rank')}"


def completed(
    facts: Mapping[str, Any], parameters: Parameters, comm: MPI.Intracomm
) -> dict[str, Any]:
    """The facts about an assembled problem with the ``estimate``; collective.

    A warning is added if the estimate is more than the memory of a machine of these ranks.
    """
    facts = dict(facts)
    compact = facts.pop("compact dofs")
    found = estimate(parameters, facts["dimension"], facts["dofs"], comm.size, compact)
    return {**facts, "estimate": found, "warnings": [*facts["warnings"], *_warnings(found, comm)]}


def estimate(
    parameters: Parameters, dim: int, unknowns: int, ranks: int, compact: int | None = None
) -> Estimate:
    """The memory for a run of the study file's base case on a mesh with so many unknowns.

    ``compact`` are those of a cube that takes as long to factorise, by default all of them.
    Adapted meshes are taken to grow to the most unknowns that the study file allows.
    """
    if parameters.adapt is not None:
        unknowns, compact = max(unknowns, parameters.adapt.max_dofs), None
    factorised: float = unknowns if compact is None else compact
    material = parameters.material
    locks = material.limits or any(part.limits for part in material.regions.values())
    extra, is_direct = 0.0, chosen(parameters.solver.linear, dim, int(factorised)) == "direct"
    if not is_direct:
        limit = FILTER_LIMIT[dim, parameters.discretisation.degree]
        factorised = _FILTERED * unknowns
        if not locks:
            # Nothing but the nodes of a side, at most.
            factorised = dim * (unknowns / dim) ** (1.0 - 1.0 / dim)
        if dim == 3 and factorised > limit:
            alone = _bounds_contrast(parameters)
            factorised = 0.0 if alone else _PROJECTED * unknowns
            extra = _ALONE * unknowns if alone else 0.0
        else:
            factorised = min(factorised, limit)
    coefficient, power = _FACTOR[dim]
    factor = (_IN_PIECES if ranks > 1 else 1.0) * coefficient * factorised**power
    memory = ranks * _RANK + (_UNKNOWN if locks else _ELASTIC)[dim] * unknowns + factor + extra
    if parameters.adapt is not None:
        return Estimate(memory, ranks, "at most")
    return Estimate(memory, ranks, "about" if is_direct or unknowns <= _LARGEST else "at least")


def _bounds_contrast(parameters: Parameters) -> bool:
    """Whether n keeps every cell so soft that multigrid does without projection.

    If Young's modulus is no number, the stiffness is unknown here.
    """
    young = parameters.material.elasticity.young
    return isinstance(young, float) and parameters.penalty.n <= MODERATE_CONTRAST * young


def _warnings(expected: Estimate, comm: MPI.Intracomm) -> list[str]:
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    share, there = expected.memory * node.size / comm.size, memory()
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


def memory() -> float | None:
    """The bytes of this machine or container; None if the system does not tell."""
    known = []
    # Not every system knows its pages; without a limit the file says "max", or there is none.
    with contextlib.suppress(ValueError, OSError):
        known.append(float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")))
    for place in _LIMITS:
        with contextlib.suppress(ValueError, OSError):
            known.append(float(Path(place).read_text(encoding="ascii")))
    return min(known, default=None)
