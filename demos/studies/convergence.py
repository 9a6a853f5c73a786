"""Distances between solutions, also on different meshes, rates of convergence, and tables."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dolfinx import fem
from transfer import on_mesh_of

from contact_locking.errors import InputError
from contact_locking.fem.compiled import integral
from contact_locking.files import write_text
from contact_locking.laws.body import squared_norm
from contact_locking.mesh.domain import Domain
from contact_locking.results.output import TABLE_LINES
from contact_locking.results.solution import StudySolution
from contact_locking.view.report.folders import Row, read_rows


@dataclass(frozen=True)
class Norms:
    """``v = |w|_V``, the L2 norm of eps(w) (10), and the L2 norms of w.

    ``l2`` is the L2 norm over the body, and ``contact`` is the L2 norm over Gamma_C.
    """

    v: float
    l2: float
    contact: float

    def over(self, other: Norms) -> Norms:
        """Each norm divided by the same norm of ``other``, unless that norm is 0."""
        mine, theirs = dataclasses.astuple(self), dataclasses.astuple(other)
        return Norms(*(a / b if b > 0.0 else a for a, b in zip(mine, theirs, strict=True)))


def norms(w: fem.Function, domain: Domain, contact: tuple[str, ...] = ()) -> Norms:
    """The norms of a displacement; ``contact`` names the parts of Gamma_C.  Collective."""
    strain = domain.kinematics.strain(w)
    squares = [integral(domain, squared_norm(f) * domain.dx()) for f in (strain, w)]
    squares.append(integral(domain, squared_norm(w) * domain.ds(contact)) if contact else 0.0)
    return Norms(*(math.sqrt(square) for square in squares))


def distance(solution: StudySolution, reference: StudySolution) -> Norms:
    """The norms of ``u - u_ref`` on the mesh of the reference; collective.

    u is interpolated on the mesh of the reference.  The interpolation is exact if that mesh refines
    the mesh of u; the meshes of structured blocks are nested if their numbers of cells divide each
    other.  Raises ValueError if the mesh of the reference reaches beyond the mesh of u.
    """
    difference = fem.Function(reference.displacement.function_space)
    difference.interpolate(on_mesh_of(solution.displacement, reference.displacement))
    difference.x.array[:] -= reference.displacement.x.array
    return norms(difference, reference.domain, reference.parameters.contact_names)


def fitted_rate(sizes: Sequence[float], errors: Sequence[float]) -> float:
    """The exponent r in ``error = C size^r``: the least-squares slope of the logarithms.

    Raises ValueError for fewer than two sizes, and for errors or sizes that are not positive.
    """
    x, y = np.asarray(sizes, dtype=float), np.asarray(errors, dtype=float)
    if len(np.unique(x)) < 2 or x.shape != y.shape:
        raise ValueError("a rate takes two or more sizes and an error for each")
    if not (np.all(x > 0.0) and np.all(y > 0.0)):
        raise ValueError("a rate takes sizes and errors above zero")
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def write_table(directory: Path, rows: Iterable[Row]) -> None:
    """Write rows of numbers and texts to ``table.jsonl`` in ``directory``. Raises OSError."""
    directory.mkdir(parents=True, exist_ok=True)
    lines = [json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n" for row in rows]
    write_text(directory / TABLE_LINES, "".join(lines))


def read_table(directory: Path) -> list[Row]:
    """The rows of a study's ``table.jsonl``. Raises InputError if it cannot be read."""
    try:
        return read_rows(directory / TABLE_LINES)
    except InputError as error:
        raise InputError(f"{error}; run its study first") from error
