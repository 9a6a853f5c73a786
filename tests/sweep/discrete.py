"""The discrete problem and its solution in NumPy, from the parameters, the mesh and nothing else.

Stresses and strains are vectors in Mandel's notation.  What the package assembles and solves with
is not used; of the solution, only the fields that a user sees are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from simplices import Body

from contact_locking.arrays import AXES, BoolArray, FloatArray
from contact_locking.contact import contact as concepts
from contact_locking.contact.pairing import Side, pair
from contact_locking.expressions import parse
from contact_locking.laws.elasticity import mean_young
from contact_locking.laws.material import Elasticity
from contact_locking.mesh.domain import Domain
from contact_locking.results.solution import StudySolution
from contact_locking.study_file.parameters import Parameters

from .boxes import Boxes
from .geometry import Geometry

IntArray = npt.NDArray[np.integer[Any]]
Matrix: TypeAlias = sp.csr_matrix


@dataclass(frozen=True)
class Contact:
    """Nodes of Gamma_C with weights, normals (k, d), gap and the rounding in that, all (k,).

    ``decides`` says where contact has a say: where the normal displacement is not prescribed, and
    ``slides`` where there is friction: where conditions leave two bodies a way to slide.
    ``seen`` maps displacements to what contact limits at the nodes, (k d, dofs): the displacement
    there, or the jump to another body.  ``controls`` maps nodal values of a field on Gamma_C to the
    values of contact there, (k, nodes).  A node is there once for each contact that it is in.
    """

    nodes: IntArray
    weights: FloatArray
    normals: FloatArray
    gap: FloatArray
    rounding: FloatArray
    decides: BoolArray
    slides: BoolArray
    seen: Matrix
    controls: Matrix

    def of(self, u: FloatArray) -> FloatArray:
        """What contact limits (k, d)."""
        return np.asarray(self.seen @ u).reshape(self.normals.shape)

    def forces(self, tractions: FloatArray) -> FloatArray:
        """The nodal forces of tractions (k, d), sizes if they are sizes."""
        signs = abs(self.seen) if np.all(tractions >= 0.0) else self.seen
        return np.asarray(signs.T @ (self.weights[:, None] * tractions).ravel())


@dataclass(frozen=True)
class Discrete:
    """min 1/2 u'Ku - f'u over u = ``prescribed`` at the dofs that are not free, and the laws.

    ``strain`` maps u to strains at c points, the middle of each simplex or the Gauss points of each
    box, with the weights ``volumes``; ``law`` (c, m, m) is A, and ``limit`` (c,) is M there.  K has
    the ``springs``, and f the forces of an eigenstrain.
    """

    geometry: Geometry
    volumes: FloatArray
    strain: Matrix
    springs: Matrix
    law: FloatArray
    limit: FloatArray
    load: FloatArray
    load_size: FloatArray
    free: BoolArray
    prescribed: FloatArray
    contact: Contact | None
    n: float
    epsilon: float
    regularisation: float

    @property
    def dim(self) -> int:
        return int(self.geometry.x.shape[1])

    @property
    def stiffness(self) -> Matrix:
        blocks = sp.block_diag(list(self.law * self.volumes[:, None, None]), "csr")
        return (self.strain.T @ blocks @ self.strain + self.springs).tocsr()

    def strains(self, u: FloatArray) -> FloatArray:
        """(c, m)."""
        return (self.strain @ u).reshape(len(self.volumes), -1)

    def forces(self, stress: FloatArray) -> FloatArray:
        """The nodal forces of a stress (c, m)."""
        return np.asarray(self.strain.T @ (stress * self.volumes[:, None]).ravel())


def discretise(
    parameters: Parameters, domain: Domain, space: Any, solution: StudySolution | None = None
) -> Discrete:
    """The discrete problem of a study on a mesh; ``space`` numbers the nodes.

    Bodies face each other where they did in the last solve for a ``solution``, else at rest.
    """
    geometry = Geometry.of(domain, space)
    places, body = _points(geometry)
    free, prescribed = _conditions(parameters, geometry)
    load, load_size = _loads(parameters, geometry, body)
    law, limit = _material(parameters, geometry, places)
    stress = body.volumes[:, None] * _thermal_stress(parameters, geometry, places, law)
    strain = body.strain.tocsr()
    load = load + strain.T @ stress.ravel()
    load_size = load_size + abs(strain).T @ np.abs(stress).ravel()
    given = parameters.penalty
    said = given.model_fields_set
    # Who says nothing of penalties asks for the inequality itself.
    n = given.n if "n" in said else math.inf
    epsilon = given.epsilon if given.epsilon is not None else (1.0 / n if "n" in said else 0.0)
    # The paper's epsilon in the place of a length, where none is given.
    length = parameters.friction.regularisation
    if length is None:
        length = epsilon * float(mean_young(law, domain.dim).min())
    return Discrete(
        geometry=geometry,
        volumes=body.volumes,
        strain=strain,
        springs=_springs(parameters, geometry),
        law=law,
        limit=limit,
        load=load,
        load_size=load_size,
        free=free,
        prescribed=prescribed,
        contact=_contact(parameters, geometry, body, free, solution),
        n=n,
        epsilon=epsilon,
        regularisation=length,
    )


def _points(geometry: Geometry) -> tuple[FloatArray, Body]:
    """The points of the laws (c, d), and the body."""
    x, cells = geometry.x, geometry.cells
    if cells.shape[1] == x.shape[1] + 1:
        return x[cells].mean(axis=1), Body(x, cells, 1.0, 0.3)
    body = Boxes(x, cells)
    return np.einsum("qc,kcd->kqd", body.shapes, x[cells]).reshape(-1, x.shape[1]), body


def _inside(geometry: Geometry, name: str, places: FloatArray) -> IntArray:
    """The numbers of the points in a region."""
    each = len(places) // len(geometry.cells)
    return np.asarray((geometry.domain.cells(name)[:, None] * each + np.arange(each)).ravel())


def at(value: Any, x: FloatArray, **more: FloatArray) -> FloatArray:
    """A number or an expression, as it is written, at points (k, d)."""
    names = AXES[: x.shape[1]]
    found = parse(getattr(value, "data", value), (*names, *more), allow_infinite=True)
    result = found.numpy(**dict(zip(names, x.T, strict=True)), **more)
    return np.broadcast_to(np.asarray(result, dtype=float), (len(x),)).copy()


def _conditions(parameters: Parameters, geometry: Geometry) -> tuple[BoolArray, FloatArray]:
    free = np.ones(geometry.x.shape, dtype=bool)
    prescribed = np.zeros(geometry.x.shape)
    for condition in parameters.loads.displacements:
        nodes = np.unique(geometry.facets(condition.on))
        for axis, value in enumerate(condition.value):
            if value is not None:
                free[nodes, axis] = False
                prescribed[nodes, axis] = at(value, geometry.x[nodes])
    return free.ravel(), prescribed.ravel()


def _loads(parameters: Parameters, geometry: Geometry, body: Body) -> tuple[FloatArray, FloatArray]:
    """Nodal forces, exact for loads that are affine in x, and the sums of what they are made of."""
    load, size = np.zeros(geometry.x.shape), np.zeros(geometry.x.shape)

    def add(elements: IntArray, measures: FloatArray, vector: Any) -> None:
        for axis, value in enumerate(vector):
            values = at(value, geometry.x)[elements]
            parts = np.einsum("fij,fj->fi", measures, values)
            np.add.at(load[:, axis], elements, parts)
            np.add.at(size[:, axis], elements, np.abs(parts))

    if parameters.loads.body_force is not None:
        count = geometry.cells.shape[1]
        if isinstance(body, Boxes):
            weights = body.volumes.reshape(len(geometry.cells), count)
            measures = np.einsum("kq,qi,qj->kij", weights, body.shapes, body.shapes)
        else:
            share = (np.ones((count, count)) + np.eye(count)) / (count * (count + 1))
            measures = body.volumes[:, None, None] * share
        add(geometry.cells, measures, parameters.loads.body_force)
    for traction in parameters.loads.tractions:
        facets = geometry.facets(traction.on)
        add(facets, geometry.measures(facets), traction.value)
    return load.ravel(), size.ravel()


def _material(
    parameters: Parameters, geometry: Geometry, middle: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """A (c, m, m) and M (c,) at the points ``middle``."""
    given = parameters.material
    law = _stiffness(given.elasticity, middle)
    limit = at(given.locking_limit, middle)
    for name, region in given.regions.items():
        where = _inside(geometry, name, middle)
        if region.elasticity is not None:
            law[where] = _stiffness(region.elasticity, middle[where])
        if region.locking_limit is not None:
            limit[where] = at(region.locking_limit, middle[where])
    return law, limit


def _thermal_stress(
    parameters: Parameters, geometry: Geometry, middle: FloatArray, law: FloatArray
) -> FloatArray:
    """``A eps_0`` (c, m); across a plane acts Lame's lambda of an isotropic law."""
    dim = geometry.x.shape[1]
    found = np.zeros(law.shape[:2])
    for _, item in parameters.material.eigenstrains:
        _, tensor = item.tensor
        given = tensor if isinstance(tensor, tuple) else (tensor,) * 3
        warm = 1.0 if item.temperature is None else at(item.temperature, middle)
        normal = np.stack([at(value, middle) * warm for value in given], axis=1)
        stress = np.einsum("cij,cj->ci", law[:, :, :dim], normal[:, :dim])
        if dim == 2 and len(given) == 3:
            stress[:, :2] += law[:, 0, 1, None] * normal[:, 2:]
        names = () if item.on is None else item.on
        parts = [_inside(geometry, name, middle) for name in names] or [np.arange(len(middle))]
        inside = np.concatenate(parts)
        found[inside] += stress[inside]
    return found


def _springs(parameters: Parameters, geometry: Geometry) -> Matrix:
    """``int k (u . m)(v . m)`` for a constant k."""
    dim, size = geometry.x.shape[1], geometry.x.size
    found = sp.csr_matrix((size, size))
    for spring in parameters.loads.springs:
        facets = geometry.facets(spring.on)
        normals = geometry.normals(facets)
        along = np.tile(np.eye(dim), (len(facets), 1, 1))
        if spring.along is not None:
            unit = normals if spring.along == "normal" else np.tile(spring.along, (len(facets), 1))
            unit = unit / np.linalg.norm(unit, axis=1)[:, None]
            along = np.einsum("fi,fj->fij", unit, unit)
        measures = float(spring.stiffness.data) * geometry.measures(facets)
        blocks = np.einsum("fab,fij->faibj", measures, along)
        dofs = (facets[:, :, None] * dim + np.arange(dim)).reshape(len(facets), -1)
        rows = np.repeat(dofs, dofs.shape[1], axis=1).ravel()
        columns = np.tile(dofs, (1, dofs.shape[1])).ravel()
        found = found + sp.csr_matrix((blocks.ravel(), (rows, columns)), (size, size))
    return found.tocsr()


def _stiffness(given: Elasticity, x: FloatArray) -> FloatArray:
    dim = x.shape[1]
    if given.stiffness is not None:
        entries: Any = given.stiffness
        rows = np.array([[at(entry, x) for entry in row] for row in entries])
        # A study file has the order yz, xz, xy in 3D, the strains here xy, xz, yz.
        order = [0, 1, 2] if dim == 2 else [0, 1, 2, 5, 4, 3]
        return np.moveaxis(rows[order][:, order], 2, 0)
    if given.young is not None and given.poisson is not None:
        young, poisson = at(given.young, x), at(given.poisson, x)
        shear = young / (2.0 * (1.0 + poisson))
        bulk = young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson))
    else:
        assert given.lame_lambda is not None and given.lame_mu is not None
        bulk, shear = at(given.lame_lambda, x), at(given.lame_mu, x)
    trace = np.r_[np.ones(dim), np.zeros(dim * (dim - 1) // 2)]
    identity = np.eye(len(trace))
    return 2.0 * shear[:, None, None] * identity + bulk[:, None, None] * np.outer(trace, trace)


def _contact(
    parameters: Parameters,
    geometry: Geometry,
    body: Body,
    free: BoolArray,
    solution: StudySolution | None,
) -> Contact | None:
    frames: list[FloatArray | None] = [None] * len(parameters.contacts)
    if solution is not None:
        frames = [fields.paired_at for fields in solution.contacts]
    pairs = zip(parameters.contacts, frames, strict=True)
    parts = [_of_part(part, geometry, body, free, frame) for part, frame in pairs]
    if len(parts) <= 1:
        return parts[0] if parts else None
    fields = ("nodes", "weights", "normals", "gap", "rounding", "decides", "slides")
    joined = {name: np.concatenate([getattr(part, name) for part in parts]) for name in fields}
    seen, controls = (
        sp.vstack([getattr(part, name) for part in parts], "csr") for name in ("seen", "controls")
    )
    return Contact(**joined, seen=seen, controls=controls)


def _of_part(
    part: concepts.Contact,
    geometry: Geometry,
    body: Body,
    free: BoolArray,
    frame: FloatArray | None,
) -> Contact:
    facets = geometry.facets(part.on)
    weights = body.nodal_areas(facets)
    nodes = np.flatnonzero(weights)
    x, dim = geometry.x[nodes], geometry.x.shape[1]
    given = part.foundation
    if given is None:
        gap = at(part.gap, x)
        normals = np.zeros_like(geometry.x)
        np.add.at(normals, facets, geometry.normals(facets)[:, None, :])
        normals = normals[nodes]
        rounding = 4e-16 * np.abs(gap)
    else:
        gap, normals, rounding = _distance(given, x)
    if part.against:
        return _between(part, geometry, gap, free, frame)
    normals = normals / np.linalg.norm(normals, axis=1)[:, None]
    decides = np.linalg.norm(normals * free.reshape(-1, dim)[nodes], axis=1) > 1e-6
    own = sp.eye(len(geometry.x), format="csr")[nodes]
    seen = sp.kron(own, sp.eye(dim), "csr")
    slides = np.ones(len(nodes), dtype=bool)
    return Contact(nodes, weights[nodes], normals, gap, rounding, decides, slides, seen, own)


def _between(
    part: concepts.Contact,
    geometry: Geometry,
    added: FloatArray,
    free: BoolArray,
    frame: FloatArray | None,
) -> Contact:
    """Contact between the sides of two bodies, with the pairing of the package at ``frame``.

    The patch tests have judged the pairing, and nodes against segments (by_segments.py).
    """
    dim, domain = geometry.x.shape[1], geometry.domain
    against: tuple[str, ...] = part.against or ()
    among = set(part.on) == set(against)

    def side(names: tuple[str, ...]) -> tuple[Side, IntArray]:
        corners = geometry.facets(names)
        owners = domain.owners(domain.facets(names))
        bodies = domain.parts[owners].astype(np.int64) if among else None
        nodes, numbers = np.unique(corners, return_inverse=True)
        normals = geometry.normals(corners)
        outward = normals / np.linalg.norm(normals, axis=1)[:, None]
        numbers = numbers.reshape(corners.shape)
        return Side(geometry.x[nodes], domain.kind.facet, numbers, outward, bodies), nodes

    (one, nodes), (two, theirs) = side(part.on), side(against)
    moved = np.zeros_like(geometry.x) if frame is None else frame.reshape(geometry.x.shape)
    if frame is not None:
        one, two = one.moved(moved[nodes]), two.moved(moved[theirs])
    found = pair(one, two)
    count = len(geometry.x)
    shares = found.shares.tocoo()
    facing = sp.csr_matrix((shares.data, (shares.row, theirs[shares.col])), (len(nodes), count))
    own = sp.csr_matrix((np.ones(len(nodes)), (np.arange(len(nodes)), nodes)), facing.shape)
    jump = sp.diags(found.faces.astype(float)) @ (found.near @ own - facing)
    seen, normals = sp.kron(jump, sp.eye(dim), "csr"), found.normals
    along = (
        sp.block_diag([normal[None] for normal in normals], "csr")
        @ seen
        @ sp.diags(free.astype(float))
    )
    decides = np.sqrt(np.asarray(along.power(2).sum(axis=1)).ravel()) > 1e-6
    extent = float(np.ptp(geometry.x, axis=0).max())
    before = np.sum((jump @ moved) * normals, axis=1)
    gap = np.where(found.faces, found.gap, extent) + before + added
    rounding = np.full(len(nodes), 1e-14 * extent)
    weights = np.where(found.faces, found.weights, extent ** (dim - 1))
    # The nodes of both sides that have the largest shares decide.
    dense = np.zeros((len(nodes), dim), dtype=bool)
    for row, differences in enumerate(jump.toarray()):
        if differences.any():
            ends = [int(np.argmax(differences)), int(np.argmin(differences))]
            dense[row] = free.reshape(-1, dim)[ends].any(axis=0)
    slides = dense.sum(axis=1) > 1
    return Contact(nodes, weights, normals, gap, rounding, decides, slides, seen, own)


def _distance(given: Any, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Signed distance, direction towards the foundation, and the rounding in the distance."""
    if given.half_space is not None:
        point, normal = np.array(given.half_space.point), np.array(given.half_space.normal)
        normal = normal / np.linalg.norm(normal)
        rounding = 1e-15 * (np.abs(x).sum(axis=1) + np.abs(point).sum())
        return (x - point) @ normal, np.tile(-normal, (len(x), 1)), rounding
    body = given.sphere or given.cylinder
    radial = x - np.array(body.centre)
    if given.cylinder is not None and x.shape[1] == 3:
        axis = np.array(body.axis or (0.0, 1.0, 0.0))
        axis = axis / np.linalg.norm(axis)
        radial = radial - np.outer(radial @ axis, axis)
    distance = np.linalg.norm(radial, axis=1)
    rounding = 2e-15 * (np.abs(x).sum(axis=1) + np.abs(body.centre).sum() + body.radius)
    return distance - body.radius, -radial, rounding


@dataclass(frozen=True)
class State:
    """A solution: nodal ``u``, stresses ``locking`` (c, m), and nodal values on Gamma_C.

    ``traction`` is sigma_tau, ``bound`` the friction bound, ``smoothed`` R sigma_nu.
    """

    u: FloatArray
    locking: FloatArray
    pressure: FloatArray
    traction: FloatArray
    bound: FloatArray
    smoothed: FloatArray


def state_of(solution: StudySolution, discrete: Discrete) -> State:
    """The fields of a solution in the order of the discrete problem."""
    dim = discrete.dim
    tensors = solution.locking_stress
    cells = tensors.function_space.dofmap.list.reshape(-1)
    locking = tensors.x.array.reshape(-1, dim, dim)[cells]
    u = solution.displacement.x.array.copy()
    if len(solution.contacts) > 1:
        # A node may be in several contacts, whose sum the fields on the mesh have.
        def joined(name: str) -> FloatArray:
            found = []
            for fields in solution.contacts:
                values = getattr(fields, name)
                by_node = np.zeros((len(discrete.geometry.x), *values.shape[1:]))
                by_node[fields.surface.blocks] = values
                found.append(by_node[np.sort(fields.surface.blocks)])
            return np.concatenate(found)

        named = ("pressure", "traction", "bound", "smoothed_stress")
        return State(u, mandel(locking), *map(joined, named))
    controls = sp.csr_matrix((0, len(discrete.geometry.x)))
    if discrete.contact is not None:
        controls = discrete.contact.controls

    def scalar(function: Any) -> FloatArray:
        # The scalar space may number the nodes in another way.
        values = np.empty(len(discrete.geometry.x))
        values[discrete.geometry.cells] = function.x.array[function.function_space.dofmap.list]
        return np.asarray(controls @ values)

    return State(
        u=u,
        locking=mandel(locking),
        pressure=scalar(solution.contact_pressure),
        traction=controls @ solution.tangential_traction.x.array.reshape(-1, dim),
        bound=scalar(solution.friction_bound),
        smoothed=scalar(solution.smoothed_stress),
    )


def mandel(tensors: FloatArray) -> FloatArray:
    """Symmetric tensors (c, d, d) as vectors (c, m)."""
    dim = tensors.shape[-1]
    shear = [math.sqrt(2.0) * tensors[:, i, j] for i, j in combinations(range(dim), 2)]
    return np.stack([*(tensors[:, i, i] for i in range(dim)), *shear], axis=1)
