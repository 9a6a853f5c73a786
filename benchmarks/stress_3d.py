"""The system of equilibrated stresses in 3D beside one elastic solve, for docs/notes/bounds.md.

    ./in-env python3 benchmarks/stress_3d.py [--full] [--uneven] 4 6 12      divisions of a cube

The element of Johnson and Mercier on tetrahedra that are cut into four at the barycentre, with the
multipliers of the faces as unknowns: the six rigid motions of each face (reduced), or all nine
affine fields.  The cube is clamped at x = 0.  With --uneven the stiffening zeta varies between the
cells by orders of magnitude, as in locked zones.  Conjugate gradients with PETSc's GAMG.
"""

from __future__ import annotations

import argparse
import itertools
import time

import dolfinx.fem.petsc as fem_petsc
import numpy as np
import scipy.linalg
import ufl
from dolfinx import fem, mesh
from mpi4py import MPI
from petsc4py import PETSc

from contact_locking.arrays import FloatArray
from contact_locking.laws.body import (
    MANDEL_PAIRS,
    isotropic_stress,
    lame_from_young,
    mandel_factor,
    strain,
)

LAME = lame_from_young(1.0, 0.3)
CORNERS = np.vstack([np.zeros(3), np.eye(3)])
FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
PARTS = np.stack([np.vstack([CORNERS[face], CORNERS.mean(axis=0)]) for face in FACES])
PAIRS = MANDEL_PAIRS[3]
UNITS = np.zeros((6, 3, 3))
for unit, (i, j) in zip(UNITS, PAIRS, strict=True):
    unit[i, j] = unit[j, i] = 1.0 / mandel_factor(i, j)
OPTIONS = {
    "ksp_type": "cg",
    "ksp_rtol": 1e-10,
    "pc_type": "gamg",
    "pc_gamg_threshold": 0.0,
    "mg_levels_pc_type": "jacobi",
    "mg_levels_ksp_max_it": 3,
}


def element() -> tuple[FloatArray, FloatArray]:
    """The divergence-free stresses (b, 4, 4, 6), and the moments (b, 4, 3, 3) on the faces."""
    rows = []
    for first, last in itertools.combinations(range(4), 2):
        # The cut between two parts has the two other corners and the barycentre.
        others = [corner for corner in range(4) if corner not in (first, last)]
        places = np.vstack([CORNERS[others], CORNERS.mean(axis=0)])
        normal = np.cross(places[1] - places[0], places[2] - places[0])
        block = np.zeros((3, 3, 4, 4, 6))
        for sign, part in ((1.0, first), (-1.0, last)):
            edges = (PARTS[part, 1:] - PARTS[part, 0]).T
            shares = np.linalg.solve(edges, (places - PARTS[part, 0]).T).T
            shares = np.column_stack([1.0 - shares.sum(axis=1), shares])
            block[:, :, part] = sign * np.einsum("qp,mij,j->qipm", shares, UNITS, normal)
        rows.append(block.reshape(-1, 96))
    divergence = np.zeros((4, 3, 4, 4, 6))
    for part in range(4):
        slopes = np.linalg.inv((PARTS[part, 1:] - PARTS[part, 0]).T)
        slopes = np.vstack([-slopes.sum(axis=0), slopes])
        divergence[part, :, part] = np.einsum("pj,mij->ipm", slopes, UNITS)
    rows.append(divergence.reshape(-1, 96))
    basis = scipy.linalg.null_space(np.concatenate(rows), rcond=1e-10).T.reshape(-1, 4, 4, 6)
    moments = np.empty((len(basis), 4, 3, 3))
    for number, face in enumerate(FACES):
        ends = CORNERS[face]
        normal = 0.5 * np.cross(ends[1] - ends[0], ends[2] - ends[0])
        normal *= np.sign(normal @ (ends[0] - CORNERS[number]))
        tractions = np.einsum("npm,mij,j->npi", basis[:, number, :3], UNITS, normal)
        mass = (np.ones((3, 3)) + np.eye(3)) / 12.0
        moments[:, number] = np.einsum("kp,npi->nki", mass, tractions)
    return basis, moments


def transforms(maps: FloatArray) -> FloatArray:
    """The matrices (n, 6, 6) of ``r -> F r F^T`` for Mandel vectors."""
    found = np.empty((len(maps), 6, 6))
    for a, (i, j) in enumerate(PAIRS):
        for b, (k, m) in enumerate(PAIRS):
            both = maps[:, i, k] * maps[:, j, m] + maps[:, i, m] * maps[:, j, k]
            found[:, a, b] = 0.5 * both * mandel_factor(i, j) * mandel_factor(k, m)
    return found


def system(cube: mesh.Mesh, full: bool, uneven: bool) -> tuple[PETSc.Mat, FloatArray]:
    """The matrix, with the rigid motions, and the right-hand side of a pull at x = 1."""
    basis, on_faces = element()
    count, topology = len(basis), cube.topology
    corners = cube.geometry.x[cube.geometry.dofmap]
    vertices = topology.connectivity(3, 0).array.reshape(-1, 4)
    faces = topology.connectivity(3, 2).array.reshape(-1, 4)
    maps = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
    sizes, total = np.abs(np.linalg.det(maps)), topology.index_map(2).size_local
    x, y, z = corners.mean(axis=1).T
    zeta = np.where(x < 0.4, 10.0 * (0.02 + y) ** 2 / (0.05 + z), 0.0) if uneven else 0.0 * x
    trace = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    stiffness = LAME[0] * np.outer(trace, trace) + 2.0 * LAME[1] * np.eye(6)
    compliance = np.linalg.inv(stiffness + zeta[:, None, None] * np.eye(6))
    moved = transforms(maps)
    inner = np.swapaxes(moved, 1, 2) @ compliance @ moved * (sizes / 24.0)[:, None, None]
    mass = (np.ones((4, 4)) + np.eye(4)) / 20.0
    gram = np.einsum("itpa,pq,jtqb->abij", basis, mass, basis).reshape(36, -1)
    local = (inner.reshape(-1, 36) @ gram).reshape(-1, count, count)
    tractions = np.einsum("xij,nfkj->xfkin", maps, on_faces) * sizes[:, None, None, None, None]
    # All cells know the corners of a face in the order of their numbers.
    order = np.argsort(vertices[:, FACES], axis=2)
    tractions = np.take_along_axis(tractions, order[..., None, None], axis=2)
    ends = np.take_along_axis(corners[:, FACES], order[..., None], axis=2)
    places = np.empty((total, 3, 3))
    places[faces] = ends
    rigid = np.concatenate([np.broadcast_to(np.eye(3), (3, 3, 3)), np.zeros((3, 3, 3))], axis=2)
    motions = np.broadcast_to(rigid, (total, 3, 3, 6)).copy()
    for axis in range(3):
        arms = places - places.mean(axis=1, keepdims=True)
        motions[..., 3 + axis] = np.cross(np.eye(3)[axis], arms)
    scale = 1.0 / np.abs(motions[..., 3:]).max()
    motions[..., 3:] *= scale
    middles = places.mean(axis=1)
    if full:
        block, near = 9, np.zeros((6, total, 3, 3))
        for axis in range(3):
            near[axis, :, :, axis] = 1.0
            near[3 + axis] = np.cross(np.eye(3)[axis], places)
        near = near.reshape(6, total, 9)
    else:
        block, near = 6, np.zeros((6, total, 6))
        tractions = np.einsum("xfkin,xfkil->xfln", tractions, motions[faces])
        for axis in range(3):
            near[axis, :, axis] = 1.0
            near[3 + axis, :, :3] = np.cross(np.eye(3)[axis], middles)
            near[3 + axis, :, 3 + axis] = 1.0 / scale
    tractions = tractions.reshape(-1, 4, block, count)
    held = np.abs(places[:, :, 0]).max(axis=1) < 1e-9
    tractions[held[faces]] = 0.0
    tractions = tractions.reshape(-1, 4 * block, count)
    values = tractions @ np.linalg.solve(local, np.swapaxes(tractions, 1, 2))
    cells, sides = np.nonzero(held[faces])
    for row in range(block):
        values[cells, sides * block + row, sides * block + row] = 1.0
    matrix = PETSc.Mat().create(MPI.COMM_SELF)
    matrix.setSizes((total * block, total * block), bsize=block)
    matrix.setType(PETSc.Mat.Type.AIJ)
    matrix.setPreallocationNNZ(7 * block)
    rows = faces.astype(PETSc.IntType)
    matrix.setValuesBlockedRCV(rows, rows, values, addv=PETSc.InsertMode.ADD_VALUES)
    matrix.assemble()
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    near[:, held] = 0.0
    modes = []
    for column in np.linalg.qr(near.reshape(6, -1).T)[0].T:
        modes.append(matrix.createVecRight())
        modes[-1].array_w[:] = column
    matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=modes))
    right = np.zeros((total, block))
    right[np.abs(places[:, :, 0] - 1.0).max(axis=1) < 1e-9, 2] = -1.0
    return matrix, right.reshape(-1)


def solve(matrix: PETSc.Mat, right: FloatArray) -> int:
    """The iterations of conjugate gradients."""
    ksp = PETSc.KSP().create(MPI.COMM_SELF)
    options = PETSc.Options("stress_3d_")
    for key, value in OPTIONS.items():
        options[key] = value
    ksp.setOptionsPrefix("stress_3d_")
    ksp.setOperators(matrix)
    ksp.setFromOptions()
    x, b = matrix.createVecs()
    b.array_w[:] = right
    ksp.solve(b, x)
    return int(ksp.getIterationNumber()) if ksp.getConvergedReason() > 0 else -1


def elastic_seconds(cube: mesh.Mesh) -> float:
    """CPU seconds of assembly, factorisation by MUMPS and solution with linear elements."""
    space = fem.functionspace(cube, ("P", 1, (3,)))
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    form = fem.form(ufl.inner(isotropic_stress(strain(u), *LAME), strain(v)) * ufl.dx)
    dofs = fem.locate_dofs_geometrical(space, lambda x: x[0] < 1e-9)
    held = fem.dirichletbc(np.zeros(3), dofs, space)
    start = time.process_time()
    matrix = fem_petsc.assemble_matrix(form, bcs=[held])
    matrix.assemble()
    ksp = PETSc.KSP().create(MPI.COMM_SELF)
    ksp.setOperators(matrix)
    ksp.setType("preonly")
    ksp.getPC().setType("lu")
    ksp.getPC().setFactorSolverType("mumps")
    x, b = matrix.createVecs()
    b.set(1.0)
    ksp.solve(b, x)
    return time.process_time() - start


def main() -> None:
    """Print a row for each cube."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--full", action="store_true", help="nine unknowns on a face")
    parser.add_argument("--uneven", action="store_true", help="zeta varies between the cells")
    parser.add_argument("divisions", type=int, nargs="+")
    given = parser.parse_args()
    print("   cells   unknowns   matrix s   iterations   solve s   elastic s   both / elastic")
    for divisions in given.divisions:
        cube = mesh.create_unit_cube(MPI.COMM_SELF, *[divisions] * 3)
        cube.topology.create_connectivity(3, 2)
        start = time.process_time()
        matrix, right = system(cube, given.full, given.uneven)
        built = time.process_time() - start
        start = time.process_time()
        iterations = solve(matrix, right)
        solved = time.process_time() - start
        elastic = elastic_seconds(cube)
        cells, ratio = cube.topology.index_map(3).size_local, (built + solved) / elastic
        print(
            f"{cells:8d} {matrix.getSize()[0]:10d} {built:10.2f} {iterations:12d} {solved:9.2f} "
            f"{elastic:11.3f} {ratio:16.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
