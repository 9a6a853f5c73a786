"""The judge of one body, or of bodies that are paired: NumPy and SciPy, and none of the package.

From nodes, cells, displacements and the reported fields it writes strains, nodal forces and laws by
itself, and compares what the package reports.  Forces are compared in the norm that K^-1 gives
them, and every law by the work by which it is violated.  What has no check of its own:

| feature                     | what is left                                                      |
| --------------------------- | ----------------------------------------------------------------- |
| gap and normals where a     | laws and balance, with the reported gap and normals               |
| bent boundary is quadratic  |                                                                   |
| the map between two bodies, | laws and balance, with the map of the package, and the reported R |
| and R between them or with  |                                                                   |
| a radius of the package     |                                                                   |
| friction where a condition  | bound and balance                                                 |
| holds a node along Gamma_C  |                                                                   |
| moments around an axis      | the force along the axis                                          |
| claims of no equilibrium    | whether the body at rest is admissible, for the claim infeasible  |
| linear solver               | the solution alone is judged                                      |
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.optimize import nnls
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

from .contact import Contact, Pairing
from .elements import Array, Body, Mesh, value
from .observed import Moment, Touch

# Forces relative to the largest, works relative to the energy, and excess of limits.
FORCE, WORK, EXCESS = 1e-6, 1e-6, 1e-6
# Agreement with what is reported.
ALIKE = 1e-7
# The allowed rounding of a sum, in units of the last digit of its terms.
DIGITS = 200.0
_EPS = float(np.finfo(float).eps)
# A displacement that is larger than the largest length of the data by this factor has run away,
# until the rounding in it was larger than the loads.
_FLIGHT = 1e3

Found = dict[str, float]


class Judge:
    """Violations of the laws in units of their tolerances, step by step."""

    def __init__(
        self, study: dict[str, Any], mesh: Mesh, pairings: Sequence[Pairing | None] = ()
    ) -> None:
        self.study, self.mesh = study, mesh
        self.body = Body(mesh, study)
        given = study["contact"]
        sections = given if isinstance(given, list) else [given]
        pairs = list(pairings) or [None] * len(sections)
        self.contacts = [
            Contact(self.body, part, study["friction"], pairing)
            for part, pairing in zip(sections, pairs, strict=True)
            if part["on"] != []
        ]
        # Who says nothing of penalties asks for the inequality itself.
        penalty = study.get("penalty") or {}
        self.n = float(penalty.get("n", math.inf))
        epsilon = penalty.get("epsilon")
        self.epsilon = 1.0 / self.n if epsilon is None else float(epsilon)
        delta = study["friction"].get("regularisation")
        # The paper's epsilon in the place of a length, where none is given.
        young = float(_mean_young(self.body.stiffness, mesh.dim).min())
        self.delta = self.epsilon * young if delta is None else float(delta)
        self.extent = float(np.ptp(mesh.x, axis=0).max())
        #: In place of the loads of the study.
        self.given_load: Array | None = None
        self.times: list[float] = []

    def loads(self, time: float) -> Array:
        """The nodal forces (k, d) of the loads."""
        return self.body.loads(time) if self.given_load is None else self.given_load

    def violations(self, moments: Sequence[Moment]) -> Found:
        """The largest violation of each law over the steps: a right solution has at most 1."""
        worst: Found = {}
        self.times = [moment.time for moment in moments]
        before, now = np.zeros_like(self.mesh.x), 0.0
        slips: list[Array] = [np.zeros(len(contact.nodes)) for contact in self.contacts]
        ways = [np.zeros_like(contact.x) for contact in self.contacts]
        for moment in moments:
            if self._is_nothing(moment, moments):
                continue
            step = _Step(self, moment, before, now, slips, ways)
            for name, ratio in step.found.items():
                worst[name] = max(worst.get(name, 0.0), ratio)
            before, now, slips, ways = moment.u, moment.time, step.slips, step.ways
        return worst

    def _is_nothing(self, moment: Moment, moments: Sequence[Moment]) -> bool:
        """Whether data and displacement are rounding of those of the other steps, as sin(pi) is."""

        def sizes(at: Moment) -> Array:
            held = [np.abs(values).max(initial=0.0) for _, _, values in self.body.held(at.time)]
            return np.array(
                [np.abs(at.u).max(), np.abs(self.loads(at.time)).max(), max(held, default=0.0)]
            )

        largest = np.max([sizes(other) for other in moments], axis=0)
        return bool(largest[0] > 0.0 and np.all(sizes(moment) <= 1e-14 * largest))

    def rest_is_admissible(self, times: Sequence[float]) -> bool:
        """Whether the body at rest follows all conditions and is outside of all foundations."""
        for time in times:
            if any(np.any(values != 0.0) for _, _, values in self.body.held(time)):
                return False
            for contact in self.contacts:
                if contact.is_bent or contact.is_free:
                    continue
                if contact.normals_and_gap(time)[1].min() < 0.0:
                    return False
        return not any(contact.is_bent for contact in self.contacts)

    def needlessness(self, moment: Moment) -> float:
        """The forces of loads and elasticity, over those of contact, friction and locking."""
        inner, _, _ = self.body.elastic_forces(moment.u)
        surface = np.zeros_like(moment.u)
        for contact, touch in zip(self.contacts, moment.contacts, strict=True):
            surface += contact.forces(touch.traction - touch.pressure[:, None] * touch.normal)
        largest = max(self.norm(surface), self.norm(self.body.forces(moment.locking)))
        return self.norm(self.loads(moment.time) - inner) / largest

    @cached_property
    def is_loose(self) -> bool:
        """Whether the conditions leave a part of the body a rigid motion."""
        cells, dim = self.mesh.cells, self.mesh.dim
        starts = np.repeat(cells[:, :1], cells.shape[1], axis=1).ravel()
        graph = sp.csr_matrix(
            (np.ones(cells.size), (starts, cells.ravel())), (len(self.mesh.x),) * 2
        )
        _, part = connected_components(graph, directed=False)
        held = np.eye(dim) - self.body.free
        for number in np.unique(part[cells]):
            nodes = np.flatnonzero(part == number)
            motions = self._rigid_motions(self.mesh.x[nodes])
            seen = np.einsum("kij,rkj->rki", held[nodes], motions).reshape(len(motions), -1)
            if np.linalg.matrix_rank(seen, tol=1e-6) < len(motions):
                return True
        return False

    def _rigid_motions(self, x: Array) -> Array:
        """(r, k, d) the motions without a strain."""
        dim = x.shape[1]
        shifts = [np.tile(axis, (len(x), 1)) for axis in np.eye(dim)]
        if self.mesh.axisymmetric:
            return np.array(shifts[1:])
        x = (x - x.mean(axis=0)) / np.ptp(x, axis=0).max()
        turns = []
        for i in range(dim):
            for j in range(i + 1, dim):
                turn = np.zeros_like(x)
                turn[:, i], turn[:, j] = -x[:, j], x[:, i]
                turns.append(turn)
        return np.array([*shifts, *turns])

    @cached_property
    def _factor(self) -> tuple[Array, Any]:
        """The scales and the factor of K in the free directions, with springs at loose contacts."""
        Q, dim = self.body.basis, self.mesh.dim
        K = self.body.matrix
        if self.is_loose:
            stiffness = float(np.median(self.body.stiffness[..., 0, 0])) / self.extent
            springs = np.zeros(len(self.mesh.x))
            for contact in self.contacts:
                springs += stiffness * (abs(contact.jump).T @ contact.weights)
            K = K + sp.diags(np.repeat(springs, dim))
        matrix = (Q.T @ K @ Q).tocsc()
        scale = 1.0 / np.sqrt(matrix.diagonal())
        return scale, splu((sp.diags(scale) @ matrix @ sp.diags(scale)).tocsc())

    def norm(self, force: Array) -> float:
        """``sqrt(f . K^-1 f)`` of nodal forces (k, d) in the free directions."""
        part = self.body.basis.T @ force.ravel()
        if not len(part):
            return 0.0
        scale, factor = self._factor
        return math.sqrt(max(float(part @ (scale * factor.solve(scale * part))), 0.0))


def _mean_young(law: Array, dim: int) -> Array:
    """Young's modulus of the isotropic tensors that are nearest to Mandel matrices (..., m, m).

    At least the smallest eigenvalue.
    """
    volumetric = law[..., :dim, :dim].sum(axis=(-2, -1)) / dim
    shear = 0.5 * (np.trace(law, axis1=-2, axis2=-1) - volumetric) / (law.shape[-1] - 1)
    lame = (volumetric - 2.0 * shear) / dim
    young = shear * (3.0 * lame + 2.0 * shear) / (lame + shear)
    return np.asarray(np.maximum(young, np.linalg.eigvalsh(law)[..., 0]))


class _Step:
    """The violations of one step; ``slips`` and the ``ways`` of foundations at its end."""

    def __init__(
        self,
        judge: Judge,
        moment: Moment,
        before: Array,
        then: float,
        slips: Sequence[Array],
        ways: Sequence[Array],
    ) -> None:
        self.judge, self.moment, self.found = judge, moment, dict[str, float]()
        body, u = judge.body, moment.u
        self.size = float(np.abs(u).max(initial=0.0))
        # What rounding in u is in a strain: flat cells have steep shape functions.
        slopes = np.abs(body.law.B).max(axis=(1, 2, 3, 4))
        self.rounding = (20.0 * _EPS * self.size * slopes)[:, None]
        self.strain = body.strain(u)
        self.loads = judge.loads(moment.time)
        self.inner, self.terms, self.elastic_energy = body.elastic_forces(u)
        self.springs = np.asarray(body.springs @ u.ravel()).reshape(u.shape)
        self.inner += self.springs
        self.terms += np.asarray(abs(body.springs) @ np.abs(u.ravel())).reshape(u.shape)
        self.terms += np.abs(self.loads)
        self.surface = np.zeros_like(u)
        self.resultants: list[tuple[Array, Array]] = []
        told = moment.summary["contacts"]
        parts = list(zip(judge.contacts, told, strict=True))
        self.ways = [contact.own_way(entry) for contact, entry in parts]
        pushes: list[Array] = []
        for contact, touch in zip(judge.contacts, moment.contacts, strict=True):
            normal = -touch.pressure[:, None] * touch.normal
            pushes.append(contact.forces(normal + touch.traction))
            self.surface += pushes[-1]
            sizes = contact.weights * (
                np.abs(touch.pressure) + np.linalg.norm(touch.traction, axis=1)
            )
            self.terms += (abs(contact.jump).T @ sizes)[:, None]
            sums = (contact.weights @ normal, contact.weights @ touch.traction)
            self.resultants.append(sums)
        self.locking = body.forces(moment.locking)
        weights = body.law.weights
        work = float(np.sum(weights * np.abs(np.sum(moment.locking * self.strain, axis=2))))
        stored = abs(float(np.sum(self.inner * u)))
        self.energy = max(stored, abs(float(np.sum(self.loads * u))), work)
        self.floor = DIGITS * _EPS * float(np.sum(np.abs(u) * self.terms))
        modulus = float(np.median(body.stiffness[..., -1, -1]))
        #: The stress in the body: a scale where a contact only grazes.
        self.stress = math.sqrt(2.0 * self.energy * modulus / float(weights.sum()))
        self._balance()
        self._locking()
        self.slips: list[Array] = []
        for i, contact in enumerate(judge.contacts):
            self._free_foundation(contact, told[i], pushes[i])
            way = (ways[i], self.ways[i])
            self._contact(contact, moment.contacts[i], before, then, way, slips[i])

    def _tell(self, name: str, wrong: Any, tolerated: Any) -> None:
        """The largest of the ratios, where both may be zero; NaN is wrong."""
        wrong = np.asarray(wrong, dtype=float)
        if wrong.size == 0:
            return
        ratio = np.where(wrong <= 0.0, 0.0, wrong / np.maximum(tolerated, 1e-300))
        worst = math.inf if np.isnan(ratio).any() else float(ratio.max())
        self.found[name] = max(self.found.get(name, 0.0), worst)

    def _balance(self) -> None:
        judge, moment, body = self.judge, self.moment, self.judge.body
        rest = self.loads + self.surface - self.inner - self.locking
        free = np.einsum("kij,kj->ki", body.free, rest)
        size = max(judge.norm(part) for part in (self.loads, self.surface, self.locking))
        # The criterion of the energy covers prescribed displacements.
        size = max(size, math.sqrt(abs(float(np.sum(self.inner * moment.u)))))
        rounding = DIGITS * _EPS * self.terms
        signs = np.where(np.arange(rest.size) * 0.618 % 1.0 < 0.5, -1.0, 1.0).reshape(rest.shape)
        tolerated = FORCE * size + judge.norm(signs * rounding)
        self._tell("equilibrium", judge.norm(rest), tolerated)
        if judge.is_loose:
            reach = [
                judge.extent,
                *(float(np.abs(v).max(initial=0)) for _, _, v in body.held(moment.time)),
            ]
            pairs = zip(judge.contacts, moment.contacts, strict=True)
            reach += [
                float(np.abs(t.gap[np.isfinite(t.gap)]).max(initial=0.0))
                for c, t in pairs
                if not c.is_free
            ]
            self._tell("flight", self.size, _FLIGHT * max(reach))
        for nodes, ways, wanted in body.held(moment.time):
            off = np.abs(np.einsum("kd,kd->k", moment.u[nodes], ways) - wanted)
            # Iterates that are larger than the solution leave their rounding in it.
            allowed = 1e-10 * max(np.abs(wanted).max(initial=0.0), self.size)
            self._tell("prescribed", off, allowed)
        # Resultants: of the loads, and of foundations, supports and springs as they are reported.
        summary, axis = moment.summary, int(judge.mesh.axisymmetric)
        told = np.array(summary["certificate"]["resultants"]["reactions"])
        grounds = [
            np.add(entry["contact_force"], entry["friction_force"])
            for contact, entry in zip(judge.contacts, summary["contacts"], strict=True)
            if contact.pairing is None
        ]
        total = self.loads.sum(axis=0) + np.sum(grounds, axis=0) + told
        around = sum(float(np.abs(part).sum()) for part in (self.loads, self.surface, rest))
        around += float(np.abs(self.springs).sum())
        tolerated = FORCE * around + float(rounding.sum())
        self._tell("balance of forces", np.abs(total[axis:]), tolerated)
        reactions = -(rest - free) - self.springs
        off = np.abs(reactions.sum(axis=0) - told)
        self._tell("reported reactions", off[axis:], tolerated)
        for entry, (normal, along) in zip(summary["contacts"], self.resultants, strict=True):
            for name, own in (("contact_force", normal), ("friction_force", along)):
                self._tell(f"reported {name}", np.abs(own - entry[name])[axis:], tolerated)
        if not axis:
            x = judge.mesh.x - judge.mesh.x.mean(axis=0)
            forces = self.loads + self.surface + reactions
            flat = ((0, 0), (0, 3 - x.shape[1]))
            moments = np.cross(np.pad(x, flat), np.pad(forces, flat)).sum(axis=0)
            self._tell("balance of moments", np.abs(moments), tolerated * judge.extent)
        stress = body.stress(self.strain)
        rigid = np.abs(body.stiffness).sum(axis=3).max(axis=2)[..., None]
        self._tell(
            "reported stress",
            np.abs(stress - moment.elastic),
            ALIKE * np.abs(stress).max() + rigid * self.rounding[..., None],
        )
        energy = summary["elastic_energy"]
        if "eigenstrain" not in judge.study["material"]:
            stored = self.elastic_energy + 0.5 * float(np.sum(self.springs * moment.u))
            tolerated = ALIKE * stored + self.floor
            self._tell("reported energy", abs(energy - stored), tolerated)

    def _locking(self) -> None:
        judge, Z, weights = self.judge, self.moment.locking, self.judge.body.law.weights
        sets = strain_sets(judge.body)
        slopes, rooms = [], []
        for maps, limit in sets:
            mapped = self.strain @ maps.T
            # A half space has one row, and no norm.
            size = mapped[..., 0] if len(maps) == 1 else np.linalg.norm(mapped, axis=2)
            slope = mapped @ maps / np.where(size == 0.0, 1.0, size)[..., None]
            slopes.append(np.broadcast_to(maps[0], slope.shape) if len(maps) == 1 else slope)
            rooms.append(limit - size)
        peak = float(np.abs(Z).max(initial=0.0))
        if not sets:
            self._tell("stress without a limit", peak, 0.0)
            return
        reach = float(np.sum(weights * np.linalg.norm(Z, axis=2) * self.rounding)) + self.floor
        if math.isfinite(judge.n) and len(sets) == 1:
            # phi(a) + phi*(b) - a b of Fenchel.
            maps, limit = sets[0]
            z = Z @ np.linalg.pinv(maps)
            size = z[..., 0] if len(maps) == 1 else np.linalg.norm(z, axis=2)
            locks = np.isfinite(limit)
            self._tell("stress without a limit", np.abs(size[~locks]), 0.0)
            over = np.maximum(-rooms[0], 0.0)
            work = np.where(locks, limit, 0.0) * size - np.sum(z * (self.strain @ maps.T), axis=2)
            work += judge.n * over**2 + size**2 / (4.0 * judge.n)
            total = abs(float(np.sum((weights * work)[locks])))
            self._tell("locking penalty", total, WORK * self.energy + reach)
            self._tell("direction of the locking stress", np.abs(Z - z @ maps), EXCESS * peak)
            return
        if math.isfinite(judge.n):
            wanted = sum(
                2.0 * judge.n * np.maximum(-room, 0.0)[..., None] * slope
                for slope, room in zip(slopes, rooms, strict=True)
            )
            tolerated = EXCESS * max(peak, self.stress) + 4.0 * judge.n * self.rounding[..., None]
            self._tell("locking penalty", np.abs(Z - wanted), tolerated)
            return
        for room, (_, limit) in zip(rooms, sets, strict=True):
            self._tell("strain beyond its limit", -room, EXCESS * limit + self.rounding)
        # The normal cone: shares of the slopes of the sets, and none where there is room.
        sizes = np.linalg.norm(Z, axis=2)
        apart = work = 0.0
        for place in zip(*np.nonzero(sizes > 1e-9 * peak), strict=True):
            frame = np.array([slope[place] for slope in slopes]).T
            shares, rest = nnls(frame, Z[place])
            room = np.array([room[place] for room in rooms])
            limit = min(limit[place] for _, limit in sets)
            work += float(weights[place] * shares @ np.abs(room))
            # Of second order, as the work of Fenchel is.
            apart += float(weights[place] * limit * rest**2 / sizes[place])
        self._tell("locking law", work, WORK * self.energy + reach)
        self._tell("direction of the locking stress", apart, WORK * self.energy + reach)

    def _free_foundation(self, contact: Contact, told: dict[str, Any], pushes: Array) -> None:
        """Force and moment on a foundation, by sums over the forces on the nodes of the body."""
        given, now = contact.section.get("foundation", {}), self.moment.time
        # A foundation that has turned out of the way is pressed by rounding alone.
        rounding = DIGITS * _EPS * float(self.terms.sum())
        size = FORCE * float(np.abs(self.surface).sum()) + rounding
        if "tool" in told:
            way = np.array(told["tool"]["direction"])
            force = contact.push(now)
            line = np.array(force if "force" in given else given["spring"]["along"], dtype=float)
            length = float(np.linalg.norm(line))
            off = np.abs(way - line / length * np.sign(way @ line)) if length else 0.0 * way
            self._tell("direction of a tool", off, 1e-9)
            stiffness = given.get("spring", {}).get("stiffness", 0.0)
            wanted = float(way @ force) - stiffness * told["tool"]["travel"]
            off = abs(float(pushes.sum(axis=0) @ way) - wanted)
            rounding = stiffness * 20.0 * _EPS * (self.size + self.judge.extent)
            # A sine is zero to rounding where the force is.
            tolerated = size + 1e-12 * contact.strongest(self.judge.times) + rounding
            self._tell("force of a tool", off, tolerated)

    def _contact(
        self,
        contact: Contact,
        touch: Touch,
        before: Array,
        then: float,
        ways: tuple[Array, Array],
        slips: Array,
    ) -> None:
        judge, moment, now = self.judge, self.moment, self.moment.time
        normals, gap = contact.normals_and_gap(now)
        pairing = contact.pairing
        faces = np.ones(len(gap), dtype=bool) if pairing is None else pairing.faces
        if contact.is_bent:
            normals, gap = touch.normal, touch.gap
        else:
            gap = contact.limited_gap(gap) + np.einsum("kd,kd->k", normals, ways[1])
            allowed = 1e-10 * judge.extent + 1e-9 * np.abs(gap)
            self._tell("reported gap", np.abs(gap - touch.gap)[faces], allowed[faces])
            self._tell("reported normal", np.abs(normals - touch.normal)[faces], 1e-7)
        open_ = contact.decides(normals)
        p, T, w = touch.pressure, touch.traction, contact.weights
        reach = float(np.abs(p).max(initial=0.0))
        size = np.linalg.norm(T, axis=1)
        self._tell("force on a held node", (np.abs(p) + size)[~open_], 1e-12 * reach)
        depth = np.einsum("kd,kd->k", contact.of(moment.u), normals) - gap
        rounding = 20.0 * _EPS * (self.size + judge.extent) + contact.rounding
        self._tell("pulling pressure", -p, EXCESS * reach)
        work = -p * depth
        floor = float(w @ np.abs(p)) * rounding + self.floor
        if judge.epsilon == 0.0:
            self._tell("penetration", depth[open_], EXCESS * self.size + rounding)
        else:
            inside = np.maximum(depth, 0.0)
            work = work + 0.5 * inside**2 / judge.epsilon + 0.5 * judge.epsilon * p**2
            floor += float(w @ inside) * rounding / judge.epsilon
        law = float(w[open_] @ np.abs(work[open_]))
        self._tell("contact law", law, WORK * self.energy + floor)
        # Friction, on the slip relative to the foundation since the step before.
        slip = contact.of(moment.u - before)
        slip = slip - contact.controls @ contact.drag(then, now) - (ways[1] - ways[0])
        slip = slip - np.einsum("kd,kd->k", slip, normals)[:, None] * normals
        far = np.linalg.norm(slip, axis=1)
        self.slips.append(slips + far)
        # Without friction nothing is smoothed.
        rubs = contact.friction["coefficient"] != 0
        smoothing = contact.friction.get("smoothing", {})
        if not rubs or smoothing.get("kernel") == "none":
            smoothed = p
        elif pairing is not None or "radius" not in smoothing:
            smoothed = -touch.smoothed
        else:
            smoothed = contact.smoothing(normals, open_) @ p
        # What rounding leaves in a traction is the force on a node over its share of the surface.
        noise = DIGITS * _EPS * float(self.terms.max()) / float(w.min())
        grain = ALIKE * reach + 1e-7 * self.stress + noise
        self._tell("reported R sigma", np.abs(smoothed + touch.smoothed)[open_], grain)
        mu = np.maximum(value(contact.friction["coefficient"], contact.x, s=slips + far), 0.0)
        bound = mu * np.abs(smoothed) * open_
        bound = np.where(contact.slides, bound, np.minimum(bound, touch.bound))
        grain = EXCESS * max(reach, float(bound.max(initial=0.0))) + 1e-7 * self.stress + noise
        self._tell("reported bound", np.abs(bound - touch.bound)[open_], grain)
        loose = contact.loose
        rubbing = open_ if pairing is None else open_ & loose
        self._tell("friction above its bound", (size - bound)[rubbing], grain)
        across = np.abs(np.einsum("kd,kd->k", T, normals))
        self._tell("friction along the normal", across, grain)
        # The bound may be off within its own tolerance.
        delta, bound = judge.delta, touch.bound
        inner = np.sqrt(np.maximum(bound**2 - size**2, 0.0))
        work = bound * np.hypot(far, delta) - delta * inner + np.einsum("kd,kd->k", T, slip)
        energy = max(self.energy, float(w @ (bound * far)))
        floor = float(w @ (bound + size)) * (rounding + EXCESS * delta) + self.floor
        total = float(w[loose] @ np.abs(work[loose]))
        self._tell("friction law", total, WORK * energy + floor)


def strain_sets(body: Body) -> list[tuple[Array, Array]]:
    """The sets |L eps| <= M, or L eps <= M for a single row, as L (r, m) and M (c, p)."""
    material, places = body.study["material"], body.law.places
    shape, x = places.shape[:2], places.reshape(-1, body.dim)
    m = body.law.B.shape[2]
    normal = body.dim + int(body.mesh.axisymmetric)
    trace = np.where(np.arange(m) < normal, 1.0, 0.0)
    limits = material.get("locking") or [
        {"norm": "strain", "at_most": material.get("locking_limit", math.inf)}
    ]
    found: list[tuple[Array, Array]] = []

    def add(maps: Array, limit: float | str, factor: float = 1.0) -> None:
        M = factor * value(limit, x).reshape(shape)
        for name, region in material.get("regions", {}).items():
            if region.get("locking_limit") is not None:
                where = body.mesh.regions[name]
                places = body.law.places[where].reshape(-1, body.dim)
                M[where] = value(region["locking_limit"], places).reshape(M[where].shape)
        if np.isfinite(M).any():
            found.append((np.atleast_2d(maps), M))

    for entry in limits:
        upper, lower = entry.get("at_most", math.inf), entry.get("at_least", -math.inf)
        if entry["norm"] == "strain":
            add(np.eye(m), upper)
        elif entry["norm"] == "deviator":
            sizes, frame = np.linalg.eigh(np.eye(m) - np.outer(trace, trace) / 3.0)
            add(np.sqrt(np.maximum(sizes, 0.0))[:, None] * frame.T, upper)
        elif entry["norm"] == "weighted":
            matrix = np.array(entry["matrix"])
            largest = np.linalg.svd(matrix, compute_uv=False)[0]
            add(matrix / largest, upper, 1.0 / largest)
        else:
            unit, factor = trace / math.sqrt(normal), 1.0 / math.sqrt(normal)
            if entry["norm"] == "direction":
                a = np.zeros(3)
                a[: body.dim] = np.array(entry["along"][: body.dim])
                a /= np.linalg.norm(a)
                pairs = {2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)]}[body.dim]
                shear = [math.sqrt(2.0) * a[i] * a[j] for i, j in pairs]
                unit, factor = np.array([*(a[:normal] ** 2), *shear]), 1.0
            add(unit, upper, factor)
            add(-unit, lower, -factor)
    return found


def complaint(found: Found) -> str:
    """The violated laws, the worst first; "" if no law is violated."""
    worst = sorted(((v, k) for k, v in found.items() if not v <= 1.0), reverse=True)
    return ", ".join(f"{name} {ratio:.2g}" for ratio, name in worst)
