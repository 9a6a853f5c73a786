"""What a solve returns: the displacement, the fields derived from it, and the summary."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from dolfinx import fem

    from contact_locking.domain import Domain
    from contact_locking.parameters import Parameters
    from contact_locking.results.derived import ContactFields

FloatArray = npt.NDArray[np.float64]

OPEN, STICK, SLIP = 0, 1, 2
STATE_NAMES = ("open", "stick", "slip")


@dataclass(frozen=True)
class ContactPoints:
    """The k nodes of Gamma_C, sorted along it in 2D and lexicographically in 3D; also in files.

    Vectors are (k, d), scalars (k,); ``state`` holds OPEN, STICK or SLIP.  ``traction`` is
    ``sigma_tau``, the friction traction on the body, and ``bound`` is ``mu |R sigma_nu|``.
    """

    x: FloatArray
    normal: FloatArray
    u_normal: FloatArray
    u_tangent: FloatArray
    gap: FloatArray
    pressure: FloatArray
    traction: FloatArray
    bound: FloatArray
    state: npt.NDArray[np.int64]

    @property
    def dim(self) -> int:
        return int(self.x.shape[1])


@dataclass
class Solution:
    """A solved state.  Fields live on every rank, what is of the contact points on rank 0 only.

    Fields on Gamma_C are P1 functions on the whole mesh, zero off Gamma_C.
    """

    parameters: Parameters
    domain: Domain
    displacement: fem.Function  # P1, vector
    strain_norm: fem.Function  # P0, |eps(u)|
    locking_limit: fem.Function  # P0, M
    locked: fem.Function  # P0, 1 where |eps| >= M (1 - 1e-6), else 0
    elastic_stress: fem.Function  # P0, (d, d): A eps(u)
    locking_stress: fem.Function  # P0, (d, d): Z
    error_indicator: fem.Function  # P0, eta_K, the error in h by stress recovery
    contact_pressure: fem.Function  # P1, -sigma_nu >= 0
    smoothed_stress: fem.Function  # P1, R sigma_nu
    tangential_traction: fem.Function  # P1, vector, sigma_tau
    contact_state: fem.Function  # P1, OPEN, STICK or SLIP
    friction_bound: fem.Function  # P1, mu |R sigma_nu|
    contacts: tuple[ContactFields, ...]  # the nodal fields of each contact, on every rank
    contact_points: ContactPoints | None
    contact_facets: npt.NDArray[np.int64] | None  # (m, d), their corners as numbers of the points
    summary: dict[str, Any] = field(default_factory=dict)

    @property
    def converged(self) -> bool:
        return bool(self.summary["converged"])
