"""probes.csv: the fields at the points of the probes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from dolfinx import fem

from contact_locking.arrays import AXES, FloatArray
from contact_locking.files.csv_file import csv_text
from contact_locking.results.probe_points import ProbePoints, ProbeSample
from contact_locking.results.solution import Solution


def sample(points: ProbePoints, solution: Solution) -> ProbeSample:
    """The fields at the points; collective.

    The columns ``stress`` are the whole stress, ``A eps(u) + Z``, with the hoop stress of an
    axisymmetric body.
    """
    dim, size = points.x.shape[1], solution.elastic_stress.ufl_shape[0]
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
    stresses = (solution.elastic_stress, solution.locking_stress)
    elastic, locking = (_local_values(points, field) for field in stresses)
    own = np.column_stack(
        [
            _local_values(points, solution.displacement),
            _local_values(points, solution.strain_norm),
            (elastic + locking)[:, places],
            locking[:, places],
        ]
    )
    parts = solution.domain.comm.gather((points.own, own))
    if parts is None:
        return ProbeSample(points, {})
    whole = np.empty((len(points), len(names)))
    for numbers, values in parts:
        whole[numbers] = values
    return ProbeSample(points, dict(zip(names, whole.T, strict=True)))


def text(samples: Sequence[ProbeSample]) -> str:
    """The table as CSV, numbers with all their digits: a row for each point and step."""
    timed = any(taken.step for taken in samples)
    axes = AXES[: samples[0].points.x.shape[1]]
    rows: list[list[Any]] = []
    for taken in samples:
        when = [taken.step, float(taken.time)] if timed else []
        places: Any = np.column_stack([taken.points.probe, taken.points.number]).tolist()
        numbers: Any = np.column_stack([taken.points.x, *taken.values.values()]).tolist()
        rows += [[*when, *place, *own] for place, own in zip(places, numbers, strict=True)]
    columns = [*(["step", "t"] if timed else []), "probe", "point", *axes, *samples[0].values]
    return csv_text(columns, rows)


def _local_values(points: ProbePoints, field: fem.Function) -> FloatArray:
    """The values (m, n) of a field at the m points of this rank."""
    size = int(np.prod(field.ufl_shape, dtype=int))
    places = np.zeros((len(points.own), 3))
    places[:, : points.x.shape[1]] = points.x[points.own]
    if not len(places):
        return np.empty((0, size))
    return np.asarray(field.eval(places, points.cells)).reshape(len(places), size)
