"""probes.csv: the fields at the points of the probes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import AXES, FloatArray
from contact_locking.results.table import Table
from contact_locking.study.probe_points import ProbePoints


@dataclass(frozen=True)
class ProbeSample:
    """The fields at all k points at one time.

    ``values`` maps the name of a column to (k,) on rank 0 and to nothing on the other ranks.
    ``step`` counts from 1; it is 0 without steps.
    """

    points: ProbePoints
    values: dict[str, FloatArray]
    step: int = 0
    time: float = 0.0


def sample(
    points: ProbePoints,
    displacement: fem.Function,
    strain_norm: fem.Function,
    elastic_stress: fem.Function,
    locking_stress: fem.Function,
) -> ProbeSample:
    """The fields at the points; collective.

    The columns ``stress`` are the whole stress, ``A eps(u) + Z``, with the hoop stress of an
    axisymmetric body.
    """
    dim, size = points.x.shape[1], elastic_stress.ufl_shape[0]
    axes = AXES[:dim]
    pairs = {f"{axes[i]}{axes[j]}": (i, j) for i in range(dim) for j in range(i, dim)}
    if size > dim:
        pairs["hoop"] = (dim, dim)
    places = [i * size + j for i, j in pairs.values()]
    names = [
        *(f"u_{axis}" for axis in axes),
        "strain_norm",
        *(f"stress_{pair}" for pair in pairs),
        *(f"locking_stress_{pair}" for pair in pairs),
    ]
    elastic, locking = (_local_values(points, field) for field in (elastic_stress, locking_stress))
    own = np.column_stack(
        [
            _local_values(points, displacement),
            _local_values(points, strain_norm),
            (elastic + locking)[:, places],
            locking[:, places],
        ]
    )
    comm = displacement.function_space.mesh.comm
    parts = comm.gather((points.own, own))
    if parts is None:
        return ProbeSample(points, {})
    whole = np.empty((len(points), len(names)))
    for numbers, values in parts:
        whole[numbers] = values
    return ProbeSample(points, dict(zip(names, whole.T, strict=True)))


def table(samples: Sequence[ProbeSample]) -> Table:
    """A row for each point, and for each step of a process."""
    timed, parts = any(taken.step for taken in samples), list[dict[str, Any]]()
    for taken in samples:
        points, every = taken.points, np.ones(len(taken.points), dtype=np.int64)
        when = {"step": taken.step * every, "t": taken.time * every} if timed else {}
        places = {"probe": points.probe, "point": points.number}
        parts.append(when | places | dict(zip(AXES, points.x.T, strict=False)) | taken.values)
    return Table({name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def _local_values(points: ProbePoints, field: fem.Function) -> FloatArray:
    """The values (m, n) of a field at the m points of this rank."""
    size = int(np.prod(field.ufl_shape, dtype=int))
    places = np.zeros((len(points.own), 3))
    places[:, : points.x.shape[1]] = points.x[points.own]
    if not len(places):
        return np.empty((0, size))
    return np.asarray(field.eval(places, points.cells)).reshape(len(places), size)
