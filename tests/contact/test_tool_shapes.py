"""Tools of any shape: signed distances as expressions, polylines and surfaces of triangles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from problems import block
from scipy.spatial import ConvexHull
from tool_files import ascii_stl, binary_stl, box

from contact_locking import InputError, Parameters, StudySolution, solve
from contact_locking.arrays import FloatArray
from contact_locking.expressions import parse
from contact_locking.expressions.tree import value_and_gradient
from contact_locking.shapes.faceted import Polyline, TriangulatedSurface
from contact_locking.shapes.shape import Distance
from contact_locking.shapes.tool_files import read_heights, read_surface

SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0))


def on(foundation: dict[str, Any], dim: int = 2, **changes: Any) -> Parameters:
    given: dict[str, Any] = {"h": 0.25 if dim == 2 else 0.5, "penalty__n": 1e3}
    contact = {"on": "bottom", "foundation": foundation}
    return block(dim, **(given | {"contact": contact} | changes))


def assert_same(a: StudySolution, b: StudySolution, within: float) -> None:
    assert a.converged and b.converged, a.summary["reason"]
    assert a.summary["contact_area"] > 0.0
    difference = np.abs(a.displacement.x.array - b.displacement.x.array).max(initial=0.0)
    assert difference < within


EXPRESSIONS = [
    "sqrt(x**2 + y**2) - 1 + 0.1*sin(3*t*x)",
    "max(abs(x) - 1, abs(y) - 0.5)",
    "x**y + atan2(y, x)",
    "(x if x < y else y**3)/(1 + exp(x))",
    "log(x)*tanh(y) - asin(0.1*x) + x**2.5 + 2**x + min(x, y, x*y) + tan(x) - sign(x)",
    "sinh(x)*cosh(y) + acos(0.2*y) + atan(x) - cos(x*y)**3",
]


@pytest.mark.serial
@pytest.mark.parametrize("text", EXPRESSIONS)
def test_gradients_of_expressions_are_those_of_differences(text: str) -> None:
    random, step = np.random.default_rng(2), 1e-6
    expression = parse(text, ("x", "y", "t"))
    at: dict[str, Any] = {"x": random.uniform(0.2, 1, 50), "y": random.uniform(0.2, 1, 50)}
    at["t"] = 0.7
    values, gradient = value_and_gradient(expression, ("x", "y"), at)
    assert values == pytest.approx(expression.numpy(**at))
    for name, slopes in zip("xy", gradient, strict=True):
        above, below = (expression.numpy(**(at | {name: at[name] + h})) for h in (step, -step))
        assert slopes == pytest.approx((above - below) / (2 * step), abs=1e-7)


@pytest.mark.parametrize("dim", [2, 3])
def test_an_expression_gives_what_the_shape_gives(dim: int) -> None:
    centre = [0.4] * (dim - 1) + [-3.0]
    squares = " + ".join(f"({x} - {c})**2" for x, c in zip("xyz"[:dim], centre, strict=True))
    shape = solve(on({"sphere": {"centre": centre, "radius": 2.995}}, dim))
    assert_same(shape, solve(on({"expression": f"sqrt({squares}) - 2.995"}, dim)), 1e-12)
    # The square of the distance is no distance; near its zeros it is one after the division.
    other = solve(on({"expression": f"{squares} - 2.995**2"}, dim))
    assert_same(shape, other, 1e-3)
    assert "foundation.gradient" in [finding.code for finding in other.warnings]


def test_an_expression_that_fails_at_a_node_of_one_rank_fails_on_all() -> None:
    with pytest.raises(InputError, match="has to be a finite number") as error:
        solve(on({"expression": "y + 0*log(0.9 - x)"}))
    assert error.value.key == "contact.foundation.expression"


def exact_distance(corners: FloatArray, triangles: FloatArray, x: FloatArray) -> FloatArray:
    """The distance (k,) of points (k, 3) from triangles, by edges and feet."""
    best: FloatArray = np.full(len(x), np.inf)
    for a, b, c in corners[triangles]:
        for start, end in ((a, b), (b, c), (c, a)):
            along = end - start
            share = np.clip((x - start) @ along / (along @ along), 0.0, 1.0)
            best = np.minimum(best, np.linalg.norm(x - start - share[:, None] * along, axis=1))
        normal = np.cross(b - a, c - a)
        height = (x - a) @ normal / (normal @ normal)
        foot = x - height[:, None] * normal
        sides = [np.cross(q - p, foot - p) @ normal for p, q in ((a, b), (b, c), (c, a))]
        over = np.all(np.array(sides) >= 0.0, axis=0)
        best = np.where(over, np.minimum(best, np.abs(height) * np.linalg.norm(normal)), best)
    return best


@pytest.mark.serial
def test_the_distance_from_triangles_has_the_right_sign_at_sharp_edges_and_corners() -> None:
    random = np.random.default_rng(1)
    directions = random.normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    triangles = ConvexHull(directions).simplices.astype(np.int64)
    corners = directions[triangles]
    inwards = np.linalg.det(corners) < 0.0
    triangles[inwards] = triangles[inwards][:, ::-1]
    # Spikes and hollows: every ray from the origin meets the surface once.
    points = directions * random.uniform(0.4, 1.0, 40)[:, None]
    surface = TriangulatedSurface(points, triangles)
    x = random.uniform(-1.1, 1.1, (1000, 3))
    shares = np.stack([np.linalg.solve(points[t].T, x.T) for t in triangles])
    inside = np.any((shares >= -1e-12).all(axis=1) & (shares.sum(axis=1) < 1.0), axis=0)
    gap = surface.gap(x.T)
    assert np.array_equal(gap < 0.0, inside)
    assert np.abs(gap) == pytest.approx(exact_distance(points, triangles, x), abs=1e-12)
    # The gradient leads to the surface; on the surface it is a normal of the surface.
    normal = surface.contact_normal(x.T)
    assert np.linalg.norm(normal, axis=0) == pytest.approx(1.0)
    assert surface.gap(x.T + gap * normal) == pytest.approx(0.0, abs=1e-12)
    on_it = surface.contact_normal(points[triangles].mean(axis=1).T).T
    facing = np.cross(*(points[triangles[:, i]] - points[triangles[:, 0]] for i in (1, 2)))
    assert np.sum(on_it * facing, axis=1) == pytest.approx(-np.linalg.norm(facing, axis=1))


def gradient_of(body: Distance, x: FloatArray, step: float = 1e-7) -> FloatArray:
    rows = [
        (body.gap(x + step * unit[:, None]) - body.gap(x - step * unit[:, None])) / (2 * step)
        for unit in np.eye(len(x))
    ]
    return np.array(rows)


@pytest.mark.serial
@pytest.mark.parametrize("closed", [True, False])
def test_a_polyline_has_its_tool_on_the_left(closed: bool) -> None:
    corners = np.array(SQUARE if closed else [(2.0, 0.0), (1.0, 0.3), (0.0, 0.0)])
    line = Polyline(corners)
    x = np.random.default_rng(4).uniform(-0.5, 1.5, (2, 300))
    if closed:
        inside = np.all((x > 0.0) & (x < 1.0), axis=0)
        apart = np.maximum(np.abs(x - 0.5) - 0.5, 0.0)
        wanted = np.where(inside, -np.minimum(x, 1 - x).min(axis=0), np.linalg.norm(apart, axis=0))
        assert line.gap(x) == pytest.approx(wanted, abs=1e-14)
        assert not line.at_open_end(x).any()
    else:
        # From right to left the left side is below.
        assert line.gap(np.array([[1.0, 1.0], [0.31, 0.29]])) == pytest.approx(
            [0.01, -0.01], rel=0.1
        )
        assert line.at_open_end(np.array([[-0.5, 0.5], [0.1, 0.5]])).tolist() == [True, False]
    smooth = np.abs(line.gap(x)) > 1e-3
    difference = gradient_of(line, x) + line.contact_normal(x)
    assert np.quantile(np.abs(difference[:, smooth]).max(axis=0), 0.98) < 1e-6


def test_a_polyline_gives_what_the_half_space_gives(tmp_path: Path) -> None:
    plane = solve(on({"half_space": {"point": [0, -0.005], "normal": [0, 1]}}))
    given: list[Any] = [[3, -0.005], [0.5, -0.005], [-2, -0.005]]
    assert_same(plane, solve(on({"polyline": given})), 1e-10)
    file = Path(MPI.COMM_WORLD.bcast(tmp_path)) / "profile.csv"
    if MPI.COMM_WORLD.rank == 0:
        file.write_text("x,y\n" + "".join(f"{x},{y}\n" for x, y in given))
    MPI.COMM_WORLD.Barrier()
    assert_same(plane, solve(on({"polyline": str(file)})), 1e-10)


@pytest.mark.parametrize("kind", ["text", "binary"])
def test_a_surface_gives_what_the_half_space_gives(kind: str, tmp_path: Path) -> None:
    folder = Path(MPI.COMM_WORLD.bcast(tmp_path))
    file = folder / "tool.stl"
    if MPI.COMM_WORLD.rank == 0:
        # In mm, while the body is in m.
        tool = box([-1000, -1000, -1005], [2000, 2000, -5])
        file.write_bytes(binary_stl(tool) if kind == "binary" else ascii_stl(tool))
    MPI.COMM_WORLD.Barrier()
    plane = solve(on({"half_space": {"point": [0, 0, -0.005], "normal": [0, 0, 1]}}, 3))
    found = solve(on({"surface": {"file": str(file), "scale": 0.001}}, 3))
    assert_same(plane, found, 1e-6 if kind == "binary" else 1e-10)
    assert found.summary["warnings"] == plane.summary["warnings"]


X, Y = np.linspace(-0.25, 1.25, 16), np.linspace(-0.25, 1.25, 11)


def heights(x: FloatArray, y: FloatArray) -> FloatArray:
    """A plane that enters the block at its left and leaves it at its right."""
    return np.asarray(0.01 - 0.02 * x + 0.004 * y)


@pytest.fixture
def grid() -> FloatArray:
    return heights(*np.meshgrid(X, Y))


def pressed(foundation: dict[str, Any]) -> StudySolution:
    contact = {"on": "bottom", "foundation": foundation}
    return solve(block(3, 0.25, contact=contact, penalty__n=1e4))


def test_a_height_map_gives_what_the_half_space_gives(folder: Path, grid: FloatArray) -> None:
    file = folder / "map.npy"
    if MPI.COMM_WORLD.rank == 0:
        np.save(file, 1e3 * grid)
    MPI.COMM_WORLD.barrier()
    spacing = [1e3 * (X[1] - X[0]), 1e3 * (Y[1] - Y[0])]
    surface = {"file": str(file), "spacing": spacing, "scale": 1e-3, "shift": [-0.25, -0.25, 0.0]}
    measured = pressed({"surface": surface})
    plane = pressed({"half_space": {"point": [0, 0, 0.01], "normal": [0.02, -0.004, 1.0]}})
    assert measured.converged and 0.0 < plane.summary["contact_area"] < 0.9
    difference = measured.displacement.x.array - plane.displacement.x.array
    assert np.abs(difference).max(initial=0.0) < 1e-9
    assert "foundation.open" not in [finding.code for finding in measured.warnings]


@pytest.mark.serial
def test_heights_are_triangles_seen_from_above(tmp_path: Path, grid: FloatArray) -> None:
    matrix = tmp_path / "matrix.csv"
    np.savetxt(matrix, grid, delimiter=",")
    points, triangles = read_heights(matrix, (X[1] - X[0], Y[1] - Y[0]))
    assert np.allclose(points[:, 2], grid.ravel()) and len(triangles) == 2 * 15 * 10
    a, b, c = points[triangles].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()


@pytest.mark.serial
@pytest.mark.parametrize(
    ("content", "spacing", "message"),
    [
        ("0,0\n1,0\n", None, "give spacing"),
        ("0,0,1\n1,0,nan\n", (1.0, 1.0), "1 of its numbers are not finite, the first in"),
        ("1,2,3\n", (1.0, 1.0), "its grid has 1 by 3 heights"),
        ("1;2;3\n4;5;6\n", (1.0, 1.0), "cannot be read as rows of numbers"),
    ],
)
def test_files_that_are_no_height_maps_are_refused(
    tmp_path: Path, content: str, spacing: tuple[float, float] | None, message: str
) -> None:
    file = tmp_path / "map.csv"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_surface(file, spacing=spacing)


@pytest.mark.serial
@pytest.mark.parametrize("heights", [[[{}, {}], [{}, {}]], [[0.0, 1j], [0.0, 1.0]]])
def test_a_numpy_file_of_objects_or_complex_numbers_is_refused(
    tmp_path: Path, heights: Any
) -> None:
    file = tmp_path / "map.npy"
    np.save(file, np.array(heights), allow_pickle=True)
    with pytest.raises(InputError, match="cannot be read as rows of numbers"):
        read_heights(file, (1.0, 1.0))
