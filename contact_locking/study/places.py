"""The boundary parts that a study file names by their places."""

from __future__ import annotations

import numpy as np

from contact_locking.arrays import AXES, BoolArray, FloatArray
from contact_locking.errors import InputError
from contact_locking.expressions import parse
from contact_locking.mesh.domain import Domain
from contact_locking.mesh.named_parts import Place, Test, with_parts
from contact_locking.study_file.parameters.mesh import BoundaryPart, MeshParameters

# A point is on a plane, or in a box, up to this share of the size of the body.
_ROUNDING = 1e-6


def with_placed_parts(domain: Domain, given: MeshParameters) -> Domain:
    """The domain with ``mesh.parts``; collective.

    Raises InputError for a value that does not fit the mesh, and for a part without facets.
    """
    if not given.parts:
        return domain
    for fault in given.dimension_faults(domain.dim):
        raise InputError(fault.message, ".".join(map(str, ("mesh", *fault.place))))
    rounding = _ROUNDING * float(np.ptp(domain.bounding_box, axis=0).max())
    places = {
        name: Place(_tests(part, domain.dim, rounding), part.on)
        for name, part in given.parts.items()
    }
    return with_parts(domain, places, "mesh.parts")


def _tests(part: BoundaryPart, dim: int, rounding: float) -> list[Test]:
    tests: list[Test] = []
    if part.plane is not None:
        point, normal = np.array(part.plane.point), np.array(part.plane.normal)
        unit = normal / np.linalg.norm(normal)

        def on_plane(x: FloatArray) -> BoolArray:
            return np.abs(unit @ x - unit @ point) <= rounding

        tests.append(on_plane)
    if part.box is not None:
        low, high = np.array(part.box)[:, :, None]

        def in_box(x: FloatArray) -> BoolArray:
            return np.all((x >= low - rounding) & (x <= high + rounding), axis=0)

        tests.append(in_box)
    if part.expression is not None:
        condition = parse(part.expression, AXES[:dim], condition=True)

        def holds(x: FloatArray) -> BoolArray:
            values = condition.numpy(**dict(zip(AXES, x, strict=False)))
            return np.broadcast_to(np.asarray(values) > 0.0, x.shape[1:])

        tests.append(holds)
    return tests
