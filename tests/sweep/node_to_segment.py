"""Contact of two bodies by nodes against segments, in NumPy and SciPy.

    K u = f + C^T p,   0 <= p  _|_  C u + g >= 0,
    (C u)_i = n_i . (u_i - (1 - s_i) u_a - s_i u_b)

for the nodes i of one side and the segments (a, b) of the other, with n_i the normal of the segment
at the foot of the perpendicular from the node.  With friction there is a force t_i along the
segment, ``|t_i| <= mu p_i``, which is opposite to the slip.  There are no mortar functions, and no
gap, pairing or frame of the package: the judge shares its laws alone.  Triangles are linear.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import nnls
from scipy.sparse import diags
from scipy.sparse.linalg import splu

from .elements import Array, Body, Index, Mesh

# Sides face each other if the cosine of the angle between their normals is below this.
_FACING = -0.2
# A node this share of a segment beyond the end of a side is still opposite to it.
_BEYOND = 0.02
# Passes for the segments and normals of the displaced sides, and the change of forces at the end.
_PASSES, _CHANGE = 12, 1e-4
# Turns for the nodes that stick and slip.
_TURNS = 200


@dataclass(frozen=True)
class Pairs:
    """The nodes (m,) of one side, the segments (m, 2) that they face, and the feet on these.

    ``shares`` (m, 2) are those of both ends of a segment in the foot, ``normals`` (m, 2) point from
    the segment to the node, and the ``gap`` (m,) is the distance along them.
    """

    nodes: Index
    segments: Index
    shares: Array
    normals: Array
    gap: Array


@dataclass(frozen=True)
class Touching:
    """Displacements (k, 2), and forces (m,) at nodes; ``force`` (2,) acts on their body.

    ``pressure`` (m,) is the normal force over the area of a node.
    """

    u: Array
    pairs: Pairs
    normal: Array
    along: Array
    pressure: Array

    @property
    def force(self) -> Array:
        n = self.pairs.normals
        return np.asarray(self.normal @ n + self.along @ _turned(n))


class TwoBodies:
    """The contact of bodies of a study between two named parts of the boundary."""

    def __init__(self, mesh: Mesh, study: dict[str, Any], sides: tuple[str, str]) -> None:
        self.body, self.sides = Body(mesh, study), sides
        size = mesh.x.size
        K = self.body.matrix.tocsc()
        # A body that contact alone holds is let go of by no more than this share.
        self.K = K + diags(1e-10 * K.diagonal(), format="csc")
        self.load = self.body.loads(1.0).ravel()
        self.fixed = np.zeros(size, dtype=bool)
        self.given = np.zeros(size)
        for nodes, ways, values in self.body.held(1.0):
            chosen = 2 * nodes + np.abs(ways).argmax(axis=1)
            self.fixed[chosen], self.given[chosen] = True, values
        self.nodes = np.unique(np.concatenate([mesh.parts[name] for name in sides]))

    @cached_property
    def _factor(self) -> Any:
        free = ~self.fixed
        options = {"SymmetricMode": True}
        K = self.K[free][:, free].tocsc()
        return splu(K, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options=options)

    def solved(self, forces: Array, given: Array) -> Array:
        """The displacements (2 k,) under forces, where some are given."""
        free, u = ~self.fixed, np.where(self.fixed, given, 0.0)
        u[free] = self._factor.solve((forces - self.K @ u)[free])
        return u

    @cached_property
    def _compliance(self) -> Array:
        """The displacements of both sides under unit forces there, (2 b, 2 b)."""
        free = np.flatnonzero(~self.fixed)
        place = np.full(len(self.fixed), -1)
        place[free] = np.arange(len(free))
        local = place[(2 * self.nodes[:, None] + np.arange(2)).ravel()]
        unit = np.zeros((len(free), len(local)))
        moves = np.flatnonzero(local >= 0)
        unit[local[moves], moves] = 1.0
        found = np.zeros((len(local), len(local)))
        found[moves] = self._factor.solve(unit)[local[moves]]
        return 0.5 * (found + found.T)

    def solve(self, on: str, friction: float = 0.0, update: bool = True) -> Touching:
        """The nodes of the side ``on`` against the segments of the other one.

        With ``update`` segments and normals are those of the displaced sides.
        """
        rest = self.solved(self.load, self.given)
        there: Array = np.zeros_like(self.body.mesh.x)
        forces: Array = np.zeros(2)
        pairs = at_rest = self.pairs(there, on)
        for number in range(_PASSES if update else 1):
            touching = self._pass(rest, there, pairs, on, friction)
            there = there + (touching.u - there) / max(1.0, number - 4.0)
            before, forces = forces, touching.force
            if np.abs(forces - before).max() <= _CHANGE * np.abs(forces).max():
                break
            pairs = self.pairs(there, on, at_rest)
        return touching

    def _pass(self, rest: Array, there: Array, pairs: Pairs, on: str, friction: float) -> Touching:
        normal, along = (self._jumps(pairs, n) for n in (pairs.normals, _turned(pairs.normals)))
        C = np.vstack([normal, along])
        S = C @ self._compliance @ C.T
        u = rest.reshape(-1, 2)[self.nodes].ravel()
        # The gap of the place without displacement, along the normals of the displaced sides.
        gap = pairs.gap - normal @ there[self.nodes].ravel()
        q = C @ u + np.concatenate([gap, np.zeros(len(gap))])
        p, t = _laws(S, q, friction)
        forces = np.zeros((len(there), 2))
        forces[self.nodes] = (C.T @ np.concatenate([p, t])).reshape(-1, 2)
        u = self.solved(self.load + forces.ravel(), self.given).reshape(-1, 2)
        return Touching(u, pairs, p, t, p / self._areas(on)[pairs.nodes])

    def _jumps(self, pairs: Pairs, ways: Array) -> Array:
        """(m, 2 b) the displacement of nodes from their feet along the ways."""
        found = np.zeros((len(ways), len(self.nodes), 2))
        rows = np.arange(len(ways))
        found[rows, np.searchsorted(self.nodes, pairs.nodes)] += ways
        for end in (0, 1):
            foot = np.searchsorted(self.nodes, pairs.segments[:, end])
            found[rows, foot] -= pairs.shares[:, end, None] * ways
        return found.reshape(len(ways), -1)

    def _areas(self, side: str) -> Array:
        """(k,) the integrals of the nodal functions over a side."""
        mesh = self.body.mesh
        found: Array = np.zeros(len(mesh.x))
        a, b = mesh.parts[side].T
        length = np.linalg.norm(mesh.x[b] - mesh.x[a], axis=1)
        for one, two in ((a, b), (b, a)):
            radius = mesh.x[:, 0] if mesh.axisymmetric else np.ones(len(mesh.x))
            size = 2.0 * np.pi if mesh.axisymmetric else 1.0
            np.add.at(found, one, size * length * (2.0 * radius[one] + radius[two]) / 6.0)
        return found

    def pairs(self, there: Array, on: str, at_rest: Pairs | None = None) -> Pairs:
        """The nodes of a side and what they face, after displacements (k, 2).

        Which nodes face something is known at rest.
        """
        mesh = replace(self.body.mesh, x=self.body.mesh.x + there)
        against = self.sides[on == self.sides[0]]
        outward = {
            side: _signed(mesh, mesh.parts[side], self.body.normals(mesh.parts[side]))
            for side in self.sides
        }
        nodes, segments = np.unique(mesh.parts[on]), mesh.parts[against]
        averaged = np.zeros_like(mesh.x)
        for end in mesh.parts[on].T:
            np.add.at(averaged, end, outward[on])
        own = averaged[nodes] / np.linalg.norm(averaged[nodes], axis=1)[:, None]
        sizes = np.linalg.norm(outward[against], axis=1)
        normals = outward[against] / sizes[:, None]
        a, b = mesh.x[segments[:, 0]], mesh.x[segments[:, 1]]
        from_a = mesh.x[nodes][:, None] - a
        raw = np.einsum("msd,sd->ms", from_a, b - a) / sizes**2
        share = np.clip(raw, 0.0, 1.0)
        away = from_a - share[..., None] * (b - a)
        distance = np.linalg.norm(away, axis=2)
        distance[own @ normals.T > _FACING] = np.inf
        # Beside the end of a segment that ends the side there is nothing.
        count = np.bincount(segments.ravel(), minlength=len(mesh.x))
        beyond = np.abs(raw - share)
        is_end = count[segments[np.arange(len(segments)), (raw > 0.5).astype(int)]] == 1
        best = distance.argmin(axis=1)
        rows = np.arange(len(nodes))
        covered = np.isfinite(distance[rows, best])
        if at_rest is None:
            covered &= ~(is_end & (beyond > _BEYOND))[rows, best]
        else:
            covered &= np.isin(nodes, at_rest.nodes)
        rows, best = rows[covered], best[covered]
        s = share[rows, best]
        shares, away = np.stack([1.0 - s, s], axis=1), away[rows, best]
        if at_rest is None:
            n, gap = normals[best], np.einsum("md,md->m", away, normals[best])
            # Outside a convex corner the way to the node is that from the corner.
            corner = (beyond[rows, best] > 0.0) & ~is_end[rows, best] & (gap > 1e-6 * sizes[best])
            far = np.where(corner, np.linalg.norm(away, axis=1), 1.0)
            n = np.where(corner[:, None], away / far[:, None], n)
            gap = np.where(corner, far, gap)
        else:
            n = self._turned_normals(segments, normals, sizes)[best]
            n = np.einsum("me,med->md", shares, n)
            n /= np.linalg.norm(n, axis=1)[:, None]
            gap = np.einsum("md,md->m", away, n)
        return Pairs(nodes[covered], segments[best], shares, n, gap)

    def _turned_normals(self, segments: Index, normals: Array, sizes: Array) -> Array:
        """The normals (f, 2, 2) at rest, turned at the ends of segments as the side turns there.

        The side turns smoothly, which the passes need to end; its corners at rest stay corners.
        """
        mesh = self.body.mesh
        rest = _signed(mesh, segments, self.body.normals(segments))
        rest /= np.linalg.norm(rest, axis=1)[:, None]
        sine = np.sum(_turned(rest) * normals, axis=1)
        angle, weight = np.zeros(len(mesh.x)), np.zeros(len(mesh.x))
        for end in segments.T:
            np.add.at(angle, end, sizes * np.arctan2(sine, np.sum(rest * normals, axis=1)))
            np.add.at(weight, end, sizes)
        angles = (angle[segments] / weight[segments])[..., None]
        return np.asarray(np.cos(angles) * rest[:, None] + np.sin(angles) * _turned(rest)[:, None])


def _turned(ways: Array) -> Array:
    return np.stack([-ways[..., 1], ways[..., 0]], axis=-1)


def _signed(mesh: Mesh, facets: Index, like: Array) -> Array:
    """The normals (f, 2) of facets on the side of others, as long as the facets are."""
    found = _turned(mesh.x[facets[:, 1]] - mesh.x[facets[:, 0]])
    return np.asarray(found * np.sign(np.sum(found * like, axis=1))[:, None])


def _laws(S: Array, q: Array, friction: float) -> tuple[Array, Array]:
    """p and t of ``0 <= p _|_ (S (p, t) + q)_1 >= 0`` and Coulomb's law.

    With friction by Newton's method for the nodes that are open, stick or slip, from those that
    touch without friction.
    """
    m = len(q) // 2
    root = _root(S[:m, :m])
    right = -solve_triangular(root, q[:m], lower=True)
    p: Array = nnls(root.T, right, maxiter=100 * m)[0]
    t: Array = np.zeros(m)
    touches = p > 0.0
    slips: Array = np.zeros(m)
    # Nodes that are held along the segments on both sides have no softness there.
    S[np.diag_indices(2 * m)] += 1e-9 * np.median(np.diag(S))
    softness, random = np.diag(S), np.random.default_rng(0)
    for turn in range(_TURNS if friction > 0.0 else 0):
        # Unknown are p where nodes touch, and t where they stick; t = slips mu p elsewhere.
        sticks = touches & (slips == 0.0)
        of_p, of_t = np.flatnonzero(touches), m + np.flatnonzero(sticks)
        columns = S[:, of_p] + friction * S[:, m + of_p] * slips[of_p]
        rows = np.concatenate([of_p, of_t])
        found = np.linalg.solve(np.hstack([columns, S[:, of_t]])[rows], -q[rows])
        p, t = np.zeros(m), np.zeros(m)
        p[of_p], t[of_t - m] = found[: len(of_p)], found[len(of_p) :]
        t += friction * slips * p
        away = S @ np.concatenate([p, t]) + q
        trial, bound = t - away[m:] / softness[m:], friction * np.maximum(p, 0.0)
        now = p - away[:m] / softness[:m] > 0.0
        ways = np.where(now & (np.abs(trial) > bound), np.sign(trial), 0.0)
        if np.array_equal(touches, now) and np.array_equal(slips, ways):
            return p, t
        # Not all at once, where that goes round in circles.
        chosen = random.random(m) < (1.0 if turn < 10 else 0.5)
        touches, slips = np.where(chosen, now, touches), np.where(chosen, ways, slips)
    if friction > 0.0:
        raise ArithmeticError(f"no states of friction after {_TURNS} turns")
    return p, t


def _root(S: Array) -> Array:
    """The factor of Cholesky."""
    size = 1e-14 * np.trace(S) / max(len(S), 1)
    return np.asarray(cholesky(S + size * np.eye(len(S)), lower=True))


def refined(mesh: Mesh) -> Mesh:
    """Each triangle in four, and each segment in two; chords of curves stay as they are."""
    count, corners = len(mesh.x), mesh.cells
    edges = np.sort(corners[:, [[1, 2], [0, 2], [0, 1]]].reshape(-1, 2))
    ends, number = np.unique(edges, axis=0, return_inverse=True)
    a, b, c = corners.T
    bc, ca, ab = (count + number.reshape(-1, 3)).T
    cells = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3)
    keys = ends @ [count, 1]

    def halves(facets: Index) -> Index:
        middle = count + np.searchsorted(keys, np.sort(facets) @ [count, 1])
        return np.stack([facets[:, 0], middle, middle, facets[:, 1]], axis=1).reshape(-1, 2)

    parts = {name: halves(facets) for name, facets in mesh.parts.items()}
    regions = {name: np.flatnonzero(np.repeat(is_in, 4)) for name, is_in in _masks(mesh)}
    x = np.concatenate([mesh.x, mesh.x[ends].mean(axis=1)])
    return Mesh(x, cells, parts, regions, mesh.axisymmetric)


def _masks(mesh: Mesh) -> list[tuple[str, npt.NDArray[np.bool_]]]:
    """Of each region whether a cell is in it."""
    cells = np.arange(len(mesh.cells))
    return [(name, np.isin(cells, chosen)) for name, chosen in mesh.regions.items()]
