"""Symmetric equilibrated stresses on triangles, and polynomials on their facets.

A triangle is cut into three at its barycentre.  The stresses are polynomials of degree k in each of
the three parts, symmetric, and have a continuous normal component across the cuts.  For k = 1 this
is the element of Johnson and Mercier (doi:10.1007/BF01403910), whose divergence-free stresses are
the second derivatives of the functions of Hsieh, Clough and Tocher.  All tables are for the
reference triangle; ``s = F r F^T``, F the matrix of the affine map, takes a reference stress r to a
stress s with the same properties.

Polynomials on facets are given by their control values, those of Bernstein's basis.  Control values
that are not negative belong to a polynomial that is not negative, and the lengths of control
vectors bound the length of a vector polynomial.  For affine polynomials the control values are the
values at the ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import basix
import numpy as np
import scipy.linalg
from dolfinx import fem
from dolfinx import mesh as dmesh
from scipy.special import comb

from contact_locking import _compat
from contact_locking.arrays import BoolArray, FloatArray, IndexArray, IntArray, flattened
from contact_locking.laws.body import MANDEL_PAIRS, tensor_values
from contact_locking.mesh.domain import Domain

#: The tensors (3, 2, 2) of the unit Mandel vectors, with which ``S : TENSORS`` is that of S.
TENSORS = tensor_values(np.eye(3), MANDEL_PAIRS[2], 2)
_CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
#: The corners of each facet of a triangle; the facet is opposite to the corner of its number.
FACETS = np.array([[1, 2], [0, 2], [0, 1]])
#: The ends (3, 2, 2) of the facets of the reference triangle.
FACET_ENDS = _CORNERS[FACETS]
# Each part has the corners of one facet and the barycentre.
_PARTS = np.stack([np.vstack([ends, _CORNERS.mean(axis=0)]) for ends in FACET_ENDS])
_EDGES = np.swapaxes(_PARTS[:, 1:] - _PARTS[:, :1], 1, 2)
# The points of the parts, and of the tests of continuity and divergence, are compared exactly.
_RANK = 1e-10


@dataclass(frozen=True)
class MacroElement:
    """The tables of the stresses of one degree k; made by :func:`macro_element`.

    Fields of degree k on the three parts are given by their values at the m ``points`` (3, m, 2) of
    degree k of each part, symmetric tensors as Mandel vectors.

    ``mass`` (m, m) is ``int phi_p phi_q`` over a part of area 1, and ``quarters`` (4, m, m) are the
    shares of the four triangles into which the midpoints of its edges divide it.  ``basis`` (b, 3,
    m, 3) spans the divergence-free stresses with a continuous normal component.  ``lifts`` (f, 3,
    m, 3) are stresses whose divergence is one at one point of the degree k - 1, in one component,
    and zero at all others; f = 3 l 2 for l such points in each part, ``load_points`` (3, l, 2).
    ``moments`` and ``lift_moments`` (., 3, k + 1, 2) are the moments
    ``|F_i| int_0^1 P_j(s) (r nu)(s) ds`` of the reference tractions on the facet i with Legendre's
    polynomials :func:`legendre`.
    """

    degree: int
    points: FloatArray
    mass: FloatArray
    quarters: FloatArray
    basis: FloatArray
    lifts: FloatArray
    moments: FloatArray
    lift_moments: FloatArray
    load_points: FloatArray


@cache
def macro_element(degree: int) -> MacroElement:
    """The tables for stresses of degree k >= 1 in the parts."""
    quarters, shape = _quarters(degree), (-1, 3, len(lattice(degree)), 3)
    continuous = scipy.linalg.null_space(_normal_jumps(degree), rcond=_RANK)
    divergence = _divergences(degree) @ continuous
    free = continuous @ scipy.linalg.null_space(divergence, rcond=_RANK)
    basis = free.T.reshape(shape)
    lifts = (continuous @ np.linalg.pinv(divergence, rcond=_RANK)).T.reshape(shape)
    return MacroElement(
        degree,
        in_parts(lattice(degree)),
        quarters.sum(axis=0),
        quarters,
        basis,
        lifts,
        _moments(degree, basis),
        _moments(degree, lifts),
        in_parts(lattice(degree - 1)),
    )


def legendre(degree: int, s: FloatArray) -> FloatArray:
    """Legendre's polynomials (q, k + 1) on [0, 1] at the points s (q,), with the norm 1 in L2."""
    values = np.polynomial.legendre.legvander(2.0 * s - 1.0, degree)
    return np.asarray(values * np.sqrt(2.0 * np.arange(degree + 1) + 1.0))


def lagrange(degree: int, points: FloatArray) -> FloatArray:
    """The Lagrange polynomials (q, m) of the reference triangle at points (q, 2)."""
    return np.asarray(_lagrange(degree).tabulate(0, points)[0, :, :, 0])


def lagrange_gradients(degree: int, points: FloatArray) -> FloatArray:
    """The gradients (q, m, 2) of the Lagrange polynomials of degree >= 1 at points (q, 2)."""
    return np.moveaxis(_lagrange(degree).tabulate(1, points)[1:, :, :, 0], 0, 2)


def lattice(degree: int) -> FloatArray:
    """The points (m, 2) of the Lagrange polynomials on the reference triangle."""
    return np.asarray(_lagrange(degree).points)


def in_parts(points: FloatArray) -> FloatArray:
    """Points (q, 2) of the reference triangle in each part, (3, q, 2)."""
    return np.asarray(_PARTS[:, :1] + points @ np.swapaxes(_EDGES, 1, 2))


def between(ends: FloatArray, s: FloatArray) -> FloatArray:
    """The points (m, q, 2) at the shares s (q,) of facets with ends (m, 2, 2)."""
    return np.asarray(ends[:, :1] * (1.0 - s)[:, None] + ends[:, 1:] * s[:, None])


@cache
def _lagrange(degree: int) -> basix.finite_element.FiniteElement:
    cell, variant = basix.CellType.triangle, basix.LagrangeVariant.gll_warped
    return basix.create_element(basix.ElementFamily.P, cell, degree, variant, discontinuous=True)


def _quarters(degree: int) -> FloatArray:
    points, weights = basix.make_quadrature(basix.CellType.triangle, max(2 * degree, 1))
    half = points / 2.0
    # Three have a corner each; the fourth is turned around.
    places = np.stack([half, half + np.array([0.5, 0.0]), half + np.array([0.0, 0.5]), 0.5 - half])
    values = np.stack([lagrange(degree, place) for place in places])
    return 0.5 * np.einsum("q,sqi,sqj->sij", weights, values, values)


def _normal_jumps(degree: int) -> FloatArray:
    """The jumps of ``r n`` at k + 1 points of each cut, as rows for all values (9 m)."""
    m, rows = len(lattice(degree)), []
    s = np.linspace(0.0, 1.0, degree + 1)
    for corner in range(3):
        along = _CORNERS.mean(axis=0) - _CORNERS[corner]
        normal = np.array([-along[1], along[0]])
        block = np.zeros((len(s), 2, 3, m, 3))
        # The cut from a corner is between the parts of the facets that meet at the corner.
        for sign, piece in zip((1.0, -1.0), [i for i in range(3) if i != corner], strict=True):
            values = _values_in_part(degree, piece, _CORNERS[corner] + np.outer(s, along))
            block[:, :, piece] = sign * np.einsum("qp,mij,j->qipm", values, TENSORS, normal)
        rows.append(block.reshape(-1, 9 * m))
    return np.concatenate(rows)


def _divergences(degree: int) -> FloatArray:
    """The divergence at the points of degree k - 1 of each part, as rows for all values (9 m)."""
    low, m = lattice(degree - 1), len(lattice(degree))
    block = np.zeros((3, len(low), 2, 3, m, 3))
    for piece, edges in enumerate(_EDGES):
        gradients = lagrange_gradients(degree, low) @ np.linalg.inv(edges)
        block[piece, :, :, piece] = np.einsum("qpj,mij->qipm", gradients, TENSORS)
    return block.reshape(-1, 9 * m)


def _moments(degree: int, stresses: FloatArray) -> FloatArray:
    """The moments (n, 3, k + 1, 2) of the tractions of stresses (n, 3, m, 3)."""
    points, weights = basix.make_quadrature(basix.CellType.interval, 2 * degree)
    s = points[:, 0]
    moments = np.empty((len(stresses), 3, degree + 1, 2))
    for facet, (first, last) in enumerate(FACET_ENDS):
        along = last - first
        normal = np.array([along[1], -along[0]])
        normal *= np.sign(normal @ (first - _CORNERS[facet]))
        values = _values_in_part(degree, facet, first + np.outer(s, along))
        tractions = np.einsum("npm,qp,mij,j->nqi", stresses[:, facet], values, TENSORS, normal)
        moments[:, facet] = np.einsum("q,qj,nqi->nji", weights, legendre(degree, s), tractions)
    return moments


def _values_in_part(degree: int, piece: int, places: FloatArray) -> FloatArray:
    """The Lagrange polynomials (q, m) of a part at places (q, 2) of the reference triangle."""
    return lagrange(degree, np.linalg.solve(_EDGES[piece], (places - _PARTS[piece, 0]).T).T)


class Triangles:
    """The n owned cells of a mesh of triangles; the constructor is collective.

    ``corners`` (n, 3, 2) are the corners, ``vertices`` (n, 3) their local numbers, ``maps`` (n, 2,
    2) the matrices F of the affine maps from the reference triangle, ``transforms`` (n, 3, 3) those
    of ``r -> F r F^T`` for Mandel vectors, and ``areas`` (n,).

    ``facets`` (n, 3) are the local numbers of the facets, each opposite to the corner of its
    column, with end points ``ends`` (n, 3, 2, 2), ``lengths`` (n, 3) and outward unit ``normals``
    (n, 3, 2).  ``signs`` (n, 3) is 1 where the facet has the direction that all ranks give the
    facet, and -1 otherwise.  ``outside`` (n, 3) marks the facets on the boundary.
    """

    def __init__(self, domain: Domain) -> None:
        mesh, topology = domain.mesh, domain.mesh.topology
        self.domain = domain
        count = topology.index_map(2).size_local
        self.corners = mesh.geometry.x[_compat.cell_corners(mesh)[:count], :2]
        self.maps = np.swapaxes(self.corners[:, 1:] - self.corners[:, :1], 1, 2)
        self.areas = 0.5 * np.abs(np.linalg.det(self.maps))
        turned = self.maps[:, None] @ TENSORS @ np.swapaxes(self.maps, 1, 2)[:, None]
        self.transforms = np.einsum("nbij,aij->nab", turned, TENSORS)
        topology.create_connectivity(2, 1)
        topology.create_connectivity(1, 2)
        #: DOLFINx's index maps of the facets and of the vertices.
        self.facet_map, self.vertex_map = topology.index_map(1), topology.index_map(0)
        self.facets: IndexArray = topology.connectivity(2, 1).array.reshape(-1, 3)[:count]
        self.vertices: IndexArray = topology.connectivity(2, 0).array.reshape(-1, 3)[:count]
        at_ends = self.vertices[:, FACETS]
        numbers = self.vertex_map.local_to_global(at_ends.reshape(-1)).reshape(at_ends.shape)
        self.signs = np.where(numbers[:, :, 0] < numbers[:, :, 1], 1.0, -1.0)
        self.outside = self._marked(dmesh.exterior_facet_indices(topology))
        self.ends = self.corners[:, FACETS]
        edges = self.ends[:, :, 1] - self.ends[:, :, 0]
        self.lengths = np.linalg.norm(edges, axis=2)
        across = np.stack([edges[:, :, 1], -edges[:, :, 0]], axis=2) / self.lengths[:, :, None]
        outward = np.einsum("nsi,nsi->ns", across, self.ends[:, :, 0] - self.corners)
        self.normals = across * np.sign(outward)[:, :, None]

    def sides_on(self, facets: IndexArray) -> tuple[IntArray, IntArray]:
        """The cells (m,) and the columns (m,) of the facets on the boundary among the given."""
        cells, sides = np.nonzero(self._marked(facets) & self.outside)
        return cells.astype(np.int64), sides.astype(np.int64)

    def moved(self, reference: FloatArray) -> FloatArray:
        """``F r F^T`` for reference stresses r as Mandel vectors; both are (n, 3, m, 3)."""
        flat = flattened(reference, kept=1)
        return (flat @ np.swapaxes(self.transforms, 1, 2)).reshape(reference.shape)

    def at_nodes(self, u: fem.Function) -> FloatArray:
        """The values (n, m, 2) of a displacement at the m nodes of each triangle."""
        return np.asarray(u.x.array.reshape(-1, 2)[u.function_space.dofmap.list[: len(self.areas)]])

    def _marked(self, facets: IndexArray) -> BoolArray:
        marks = np.zeros(self.facet_map.size_local + self.facet_map.num_ghosts, dtype=np.bool_)
        marks[facets] = True
        return np.asarray(marks[self.facets])


def bernstein(degree: int, s: FloatArray) -> FloatArray:
    """Bernstein's polynomials (..., r + 1) of degree r on [0, 1] at points s (...,)."""
    i, x = np.arange(degree + 1), s[..., None]
    return np.asarray(comb(degree, i) * x**i * (1.0 - x) ** (degree - i))


def control_values(nodal: FloatArray) -> FloatArray:
    """The control values (m, r + 1) of values at the r + 1 equidistant points of facets."""
    degree = nodal.shape[1] - 1
    return nodal @ np.linalg.inv(bernstein(degree, np.arange(degree + 1) / degree)).T


def legendre_moments(control: FloatArray, degree: int) -> FloatArray:
    """The moments (m, k + 1, ...) on [0, 1] with Legendre's polynomials up to degree k."""
    own_degree = control.shape[1] - 1
    s, weights = _rule(own_degree + degree)
    table = np.einsum("q,qj,qi->ji", weights, legendre(degree, s), bernstein(own_degree, s))
    return np.einsum("ji,mi...->mj...", table, control)


def product_integral(a: FloatArray, b: FloatArray) -> FloatArray:
    """``int_0^1 a b`` (m,) for control values a (m, r + 1) and b (m, q + 1)."""
    da, db = a.shape[1] - 1, b.shape[1] - 1
    s, weights = _rule(da + db)
    table = np.einsum("q,qi,qj->ij", weights, bernstein(da, s), bernstein(db, s))
    return np.einsum("mi,ij,mj->m", a, table, b)


def absolute_integral(a: FloatArray, b: FloatArray) -> FloatArray:
    """``int_0^1 a |b|`` (m,) for control values a (m, r + 1), and b (m, 2) or (m, 3).

    The interval is divided at the zeros of b, so that the integral is exact.
    """
    da, db = a.shape[1] - 1, b.shape[1] - 1
    cuts = np.column_stack([np.zeros(len(b)), _zeros(b), np.ones(len(b))])
    points, weights = _rule(da + db)
    sizes = np.diff(cuts)
    s = cuts[:, :-1, None] + points * sizes[:, :, None]
    first = np.einsum("mcqi,mi->mcq", bernstein(da, s), a)
    second = np.einsum("mcqi,mi->mcq", bernstein(db, s), b)
    return np.asarray(np.sum((first * np.abs(second)) @ weights * sizes, axis=1))


def _rule(degree: int) -> tuple[FloatArray, FloatArray]:
    points, weights = basix.make_quadrature(basix.CellType.interval, degree)
    return points[:, 0], weights


def _zeros(b: FloatArray) -> FloatArray:
    """The zeros of polynomials in (0, 1), in ascending order; 0 or 1 in place of the others."""
    if b.shape[1] == 2:
        b = np.column_stack([b[:, 0], b.mean(axis=1), b[:, 1]])
    # b0 (1 - s)^2 + 2 b1 s (1 - s) + b2 s^2 = p s^2 - 2 q s + b0.
    p, q, c = b[:, 0] - 2.0 * b[:, 1] + b[:, 2], b[:, 0] - b[:, 1], b[:, 0]
    root = np.sqrt(np.maximum(q * q - p * c, 0.0))
    far = q + np.where(q >= 0.0, root, -root)
    first = np.divide(far, p, out=np.zeros_like(p), where=np.abs(p) > 1e-300)
    second = np.divide(c, far, out=np.zeros_like(p), where=np.abs(far) > 1e-300)
    return np.sort(np.clip(np.column_stack([first, second]), 0.0, 1.0), axis=1)
