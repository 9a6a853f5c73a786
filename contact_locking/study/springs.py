"""The springs of a study file on the boundary."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import ufl
from dolfinx import fem

from contact_locking.arrays import AXES, FloatArray
from contact_locking.errors import InputError
from contact_locking.expressions import parse
from contact_locking.fields.sampling import Entities, features, rule
from contact_locking.fields.values import evaluate
from contact_locking.mesh.domain import Domain
from contact_locking.parallel import minimum
from contact_locking.problem.springs import Springs
from contact_locking.study_file.parameters import Spring

# The rule of integration of an expression on a facet, beside two displacements.
_DEGREE = 6


def springs_of(domain: Domain, given: Sequence[Spring]) -> tuple[list[Springs], list[str]]:
    """The springs of each boundary part, and warnings; collective.

    Raises InputError for a stiffness that is not positive somewhere.
    """
    found, told = [], []
    for number, item in enumerate(given):
        key = f"loads.springs.{number}"
        for name in item.on:
            facets = Entities.of(domain, domain.dim - 1, domain.facets((name,), f"{key}.on"))
            told += _warnings(facets, item.stiffness, f"{key}.stiffness")
            measure = domain.ds((name,), f"{key}.on", quadrature_degree=_DEGREE)
            found.append(Springs(name, _stiffness(domain, item), _along(domain, item), measure))
    return found, told


def _warnings(facets: Entities, value: float | str, key: str) -> list[str]:
    expression = parse(value, AXES)
    if expression.is_constant:
        return []
    points, _ = rule(facets.dim, 0, _DEGREE)
    domain = facets.domain
    places: FloatArray = np.einsum("qc,kcd->kqd", points, facets.corners).reshape(-1, domain.dim)
    values = evaluate(domain.comm, value, places.T, key)
    least = minimum(domain.comm, values)
    if not least > 0.0:
        raise InputError(f"must be positive everywhere, and is {least:g} somewhere", key)
    return features(facets, expression, key, "refine the mesh there")


def _stiffness(domain: Domain, item: Spring) -> ufl.core.expr.Expr:
    expression = parse(item.stiffness, AXES)
    if expression.is_constant:
        return fem.Constant(domain.mesh, float(expression.numpy()))
    x = ufl.SpatialCoordinate(domain.mesh)
    return expression.ufl({}, **{axis: x[i] for i, axis in enumerate(AXES[: domain.dim])})


def _along(domain: Domain, item: Spring) -> ufl.core.expr.Expr | None:
    if item.along is None:
        return None
    if item.along == "normal":
        return ufl.FacetNormal(domain.mesh)
    unit = np.array(item.along) / np.linalg.norm(item.along)
    return ufl.as_vector(unit.tolist())
