"""One contact: a part of Gamma_C with its rigid foundation and its friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from dolfinx import fem
from ufl.core.expr import Expr

from contact_locking.arrays import BoolArray, FloatArray
from contact_locking.contact.obstacles import Obstacle
from contact_locking.contact.slip_memory import SlipMemory
from contact_locking.contact.smoothing import Smoothing
from contact_locking.contact.surface import ContactSurface
from contact_locking.laws.convex import normal_part, tangential_part
from contact_locking.laws.friction_law import Coefficient, FrictionLaw
from contact_locking.parallel import maximum

# The central differences of mu take steps of this share of the slip.
_DIFFERENCE = 1e-3


class FrictionBound:
    """``G(p, s) = mu(x, s) |R p|`` (6): the bound of the friction traction at the nodes.

    ``law`` maps points (k, d) and accumulated slips s (k,) to ``mu`` (k,): a
    :class:`~contact_locking.laws.friction_law.FrictionLaw`, or a function, for which the
    certificate samples mu* and L_mu.  ``smoothing`` is R.  ``frictionless`` says that mu is zero
    everywhere. A user's own friction bound is a subclass with another :meth:`evaluate`.
    """

    def __init__(
        self,
        surface: ContactSurface,
        smoothing: Smoothing,
        law: FrictionLaw | Coefficient,
        frictionless: bool = False,
    ) -> None:
        self.surface, self.smoothing, self.frictionless = surface, smoothing, frictionless
        self.law = law if isinstance(law, FrictionLaw) else FrictionLaw(law)
        #: The factor of mu; a solver lowers the factor to find how much friction has a solution.
        self.share = 1.0

    def evaluate(self, pressure: FloatArray, slip: FloatArray) -> FloatArray:
        """The friction bound (k,) at the owned nodes; collective.

        ``pressure`` (k,) is ``-sigma_nu``, and ``slip`` (k,) is the accumulated slip.
        """
        return self.coefficient(slip) * np.abs(self.smoothing.apply(pressure))

    def coefficient(self, slip: FloatArray) -> FloatArray:
        """``mu(x, s)`` (k,) at the nodes; collective."""
        return self.share * self.law(self.surface.points, slip)

    def slope(self, slip: FloatArray) -> FloatArray:
        """``d mu/ds`` (k,) at the nodes, by central differences; collective."""
        largest = maximum(self.surface.domain.comm, slip)
        if largest == 0.0:
            return np.zeros_like(slip)
        width = _DIFFERENCE * slip + _DIFFERENCE**2 * largest
        low, high = np.maximum(slip - width, 0.0), slip + width
        return (self.coefficient(high) - self.coefficient(low)) / (high - low)

    @property
    def depends_on_slip(self) -> bool:
        """Whether mu may depend on the slip: the law alone says that it does not."""
        return self.law.lipschitz != 0.0

    @property
    def is_coulomb(self) -> bool:
        """Whether the friction bound is (6) and not a user's own."""
        return type(self).evaluate is FrictionBound.evaluate


@dataclass(eq=False)
class Contact:
    """Signorini's conditions (5) and Coulomb's law (6) on one part of Gamma_C.

    ``key`` is the key of the contact in the study file, and ``on`` names its boundary parts.
    ``obstacle`` is what the body does not enter.  ``normal`` and ``gap`` are functions with the
    normal and the limited value of the gap at the nodes.  ``friction`` computes the friction bound
    of pressures and slips; ``bound`` is the function with the friction bound that the forms use at
    present.  ``regularisation`` is the length that smooths friction.  ``free`` (k,) marks the nodes
    whose normal displacement is not prescribed; neither pressure nor friction acts at the other
    nodes.  ``memory`` is what friction remembers of earlier steps.  ``is_pushed`` says that a force
    pushes the foundation, and ``travel`` (d,) is the displacement that the force gives to it.
    """

    key: str
    on: tuple[str, ...]
    surface: ContactSurface
    obstacle: Obstacle
    normal: fem.Function
    gap: fem.Function
    friction: FrictionBound
    regularisation: fem.Constant
    free: BoolArray
    bound: fem.Function = field(init=False)
    memory: SlipMemory = field(init=False)
    travel: FloatArray = field(init=False)
    is_pushed: bool = False

    def __post_init__(self) -> None:
        count = len(self.surface.nodes)
        # The travel when the step began, and the gaps without travel.
        self._travelled: FloatArray = np.zeros(self.surface.domain.dim)
        self.travel, self._gaps = self._travelled, self.gaps
        # How far the obstacle itself has moved in the step.
        self._drag: FloatArray = np.zeros((count, self.surface.domain.dim))
        self.bound = self.surface.scalar_function(np.zeros(count), "friction_bound")
        self.memory = SlipMemory(self.surface)

    @property
    def normals(self) -> FloatArray:
        """The contact normal (k, d) at the nodes."""
        dim = self.surface.domain.dim
        return np.asarray(self.normal.x.array.reshape(-1, dim)[self.surface.blocks])

    @property
    def gaps(self) -> FloatArray:
        """The gap (k,) at the nodes."""
        return np.asarray(self.gap.x.array[self.surface.nodes])

    @property
    def moves(self) -> bool:
        """Whether the foundation moves, by a given motion or by a force."""
        return self.obstacle.moves or self.is_pushed

    def place_obstacle(self, gaps: FloatArray, normals: FloatArray, drag: FloatArray) -> None:
        """Put the obstacle to its place at the present time; collective.

        ``gaps`` (k,) and ``normals`` (k, d) are those without the travel, and ``drag`` (k, d) is
        how far the obstacle has moved in the step.
        """
        self._gaps, self._drag = gaps, drag
        dim = self.surface.domain.dim
        self.normal.x.array.reshape(-1, dim)[self.surface.blocks] = normals
        self.normal.x.scatter_forward()
        self.move_foundation(self.travel)

    def move_foundation(self, travel: FloatArray) -> None:
        """Let the force move the foundation by ``travel`` (d,) in all; collective."""
        self.travel, normals = travel, self.normals
        self.gap.x.array[self.surface.nodes] = self._gaps + normals @ travel
        self.gap.x.scatter_forward()
        self.memory.drag_by(self._drag + (travel - self._travelled), normals)

    def split(self, u: fem.Function) -> tuple[FloatArray, FloatArray]:
        """``u_nu`` (k,) and ``u_tau`` (k, d) at the nodes, of the limited values of u."""
        return self.split_nodal(self.surface.limited.of_function(u))

    def parts(self, v: Expr) -> tuple[Expr, Expr]:
        """``v_nu`` and ``v_tau`` in UFL, of a field of the space of limited values."""
        return normal_part(v, self.normal), tangential_part(v, self.normal)

    def limited(self, v: Expr) -> Expr:
        """The field of the space of limited values for a displacement or an argument."""
        return self.surface.limited.of(v)

    def split_nodal(self, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The normal components (k,) and the tangential parts (k, d) of vectors (k, d)."""
        normals = self.normals
        along = np.einsum("ki,ki->k", vectors, normals)
        return along, vectors - along[:, None] * normals

    def acting(self, values: FloatArray) -> FloatArray:
        """Pressures or friction bounds (k,), zero at the nodes that are not free."""
        return np.where(self.free, values, 0.0)

    def friction_bound(self, u: fem.Function, pressure: FloatArray) -> FloatArray:
        """The friction bound (k,) of a displacement and a pressure (k,); collective.

        It is zero at the nodes that are not free, where R gives the mean of the pressure around.
        """
        return self.acting(self.friction.evaluate(pressure, self.slips(u)))

    def increment(self, u: fem.Function) -> FloatArray:
        """The slip of the step, ``u_tau - u_{k-1,tau}`` (k, d), at the nodes.

        On a foundation that moves the slip is relative to it.
        """
        return self.split(u)[1] - self.memory.tangential

    def slips(self, u: fem.Function) -> FloatArray:
        """The accumulated slip ``s_k = s_{k-1} + |u_tau - u_{k-1,tau}|`` (k,) at the nodes."""
        return self.memory.slip + np.linalg.norm(self.increment(u), axis=1)

    def remember(self, u: fem.Function, sticks: BoolArray) -> None:
        """End the step with the displacement u: the next step begins there; collective.

        At nodes that stick (k,) without regularisation the slip is zero but for the tolerance of
        the solver, which would add up over many steps: these nodes keep their place.
        """
        holds = sticks & (float(self.regularisation.value) == 0.0)
        along, tangential = self.split(u)
        place = np.where(holds[:, None], self.memory.tangential, tangential)
        slip = np.where(holds, self.memory.slip, self.slips(u))
        self.memory.set(place, slip, along[:, None] * self.normals)
        self._travelled = self.travel

    def recall(self, place: FloatArray, slip: FloatArray) -> None:
        """Remember ``u_{k-1,tau}`` (k, d) and the slip (k,) at the present travel; collective."""
        self.memory.set(place, slip)
        self._travelled = self.travel

    @property
    def bounds(self) -> FloatArray:
        """The friction bound (k,) that the forms use at present."""
        return np.asarray(self.bound.x.array[self.surface.nodes])

    @bounds.setter
    def bounds(self, values: FloatArray) -> None:
        self.bound.x.array[self.surface.nodes] = values
        self.bound.x.scatter_forward()

    def norm(self, values: FloatArray) -> float:
        """The L2 norm on this part of Gamma_C by the nodal weights; collective."""
        local = float(np.sum(self.surface.weights * values**2))
        return float(np.sqrt(self.surface.domain.comm.allreduce(local)))


def joint_norm(contacts: Sequence[Contact], values: Sequence[FloatArray]) -> float:
    """The L2 norm over all contacts of values (k,) for each contact; collective."""
    norms = [contact.norm(part) for contact, part in zip(contacts, values, strict=True)]
    return float(np.linalg.norm(norms)) if len(norms) > 1 else sum(norms)
