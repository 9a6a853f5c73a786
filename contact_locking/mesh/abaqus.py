"""Decks of Abaqus and CalculiX.

Sets of cells become regions; sets of nodes, surfaces and sets of facets parts of the boundary.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from pathlib import Path

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.files import require_file
from contact_locking.findings import Finding
from contact_locking.mesh.checks import CellFacets
from contact_locking.mesh.data import (
    HEXAHEDRON,
    QUADRILATERAL,
    TETRAHEDRON,
    TRIANGLE,
    CellKind,
    MeshData,
    MeshElements,
    flat_points,
    named_elements,
)

#: Kinds, None for solids that no body may have, by dimension and nodes of a cell of any order.
KINDS: Mapping[tuple[int, int], CellKind | None] = {
    **dict.fromkeys(((2, 3), (2, 6), (2, 7)), TRIANGLE),
    **dict.fromkeys(((2, 4), (2, 8), (2, 9)), QUADRILATERAL),
    **dict.fromkeys(((3, 4), (3, 10)), TETRAHEDRON),
    **dict.fromkeys(((3, 8), (3, 20), (3, 24), (3, 27)), HEXAHEDRON),
    **dict.fromkeys(((3, 5), (3, 6), (3, 13), (3, 15)), None),
}


@dataclass(frozen=True)
class Block:
    """Cells that a deck calls by one ``name``.

    ``nodes`` (k, n) are indices of points, the corners first, in the order of Gmsh.
    """

    name: str
    dim: int
    nodes: IntArray

    @property
    def kind(self) -> CellKind | None:
        """The kind of the cells, None for one that no body may have."""
        return KINDS[self.dim, self.nodes.shape[1]]

    @property
    def corners(self) -> IntArray:
        return self.nodes[:, : self.kind.corners] if self.kind is not None else self.nodes


# The types of elements with the number of their nodes: solids, and those of planes and shells.
_SOLID = re.compile(r"(?:DC3D|AC3D|C3D|SC)(\d+)")
_PLANE = re.compile(r"(?:CPS|CPEG|CPE|CGAX|CAX|DCAX|DC2D|M3D|R3D|STRI|S)(\d)")
# The corners of the sides S1, S2 and so on by the kind of the cell.
_SIDES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetrahedron": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "hexahedron": (
        *((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1)),
        *((1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
    ),
}
_SIDE = re.compile(r"[SE]([1-6])")
# Cards that make nodes or elements out of others.
_GENERATORS = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY")
_DEEPEST = 10


@dataclass(frozen=True)
class Card:
    """A keyword with its options and its lines of data, in the part of that name if any."""

    keyword: str
    options: dict[str, str]
    lines: list[str] = field(default_factory=list)
    part: str = ""

    @property
    def rows(self) -> list[list[str]]:
        """The entries of each line."""
        return [[entry.strip() for entry in line.split(",")] for line in self.lines]

    def name(self, option: str) -> str:
        """The name of a set: that in an option, behind the part."""
        return f"{self.part}.{self.options[option]}" if self.part else self.options[option]


def _require_read(cards: Sequence[Card]) -> None:
    """Raise InputError for cards whose nodes and elements are not read."""
    for keyword in (card.keyword for card in cards if card.keyword in _GENERATORS):
        raise InputError(
            f"*{keyword} generates nodes or elements, which is not supported; let the preprocessor "
            "write all of them"
        )
    instances = [card for card in cards if card.keyword == "INSTANCE"]
    if len(instances) > 1 or any(card.lines for card in instances):
        raise InputError(
            "*INSTANCE moves parts, which is not supported; write one mesh of all (in "
            "Abaqus/CAE Model > Edit Attributes > Do not use parts and assemblies in input files)"
        )


def _cards(path: Path, depth: int = 0, part_name: str = "") -> Iterator[Card]:
    """The cards of a file and of those that it includes."""
    try:
        raw = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror}") from None
    if depth > _DEEPEST:
        raise InputError(f"{path} is included by a file that it includes itself")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = raw.decode("latin-1")
    lines = (line for line in map(str.strip, text.splitlines()) if line and line[:2] != "**")
    data: list[str] = []
    for line in lines:
        if not line.startswith("*"):
            data.append(line)
            continue
        while line.endswith(","):
            line += next(lines, "")
        head, *words = line[1:].split(",")
        pairs = (word.partition("=") for word in words)
        options = {name.strip().upper(): value.strip().strip('"') for name, _, value in pairs}
        keyword, data = " ".join(head.upper().split()), []
        if keyword in ("PART", "END PART"):
            part_name = options.get("NAME", "")
        yield Card(keyword, options, data, part_name)
        if keyword == "INCLUDE":
            yield from _cards(path.parent / options.get("INPUT", ""), depth + 1, part_name)


class Sets:
    """Sets of nodes or of elements by name, whose case does not count."""

    def __init__(self) -> None:
        #: The members by their numbers in the deck.
        self.numbers: dict[int, int] = {}
        self._members = defaultdict[str, list[int]](list)
        self._spelled: dict[str, str] = {}

    def of(self, name: str) -> list[int]:
        """The members of a set, to which others can be added."""
        self._spelled.setdefault(name.upper(), name)
        return self._members[name.upper()]

    def named(self, card: Card, entry: str) -> list[int]:
        """The members that an entry of a set names: a number or a set, perhaps of an instance."""
        entry = entry.strip('"').upper()
        word = entry.rpartition(".")[2]
        if word.isdecimal() and entry not in self._members:
            number = self.numbers.get(int(word))
            return [] if number is None else [number]
        in_part = f"{card.part}.{word}".upper()
        in_parts = (name for name in self._members if name.endswith(f".{word}"))
        names = (in_part, entry, word, *in_parts)
        return next((self._members[name] for name in names if name in self._members), [])

    def without(self, names: Iterator[str] | Sequence[str]) -> dict[str, IntArray]:
        """The members (k,) of all other sets, as they are spelled."""
        hidden = {name.upper() for name in names}
        return {
            self._spelled[name]: np.unique(np.array(members, dtype=np.int64))
            for name, members in self._members.items()
            if name not in hidden
        }


class Deck:
    """The data of the cards read so far; nodes and elements are numbered in their order.

    ``points`` (m, 3) are the nodes, ``blocks`` the cells, and ``left_out`` counts the elements that
    are no cells, such as springs.  ``surfaces`` are the facets by their corners.
    """

    def __init__(self) -> None:
        self.points: FloatArray = np.zeros((0, 3))
        self.blocks, self.left_out = list[Block](), Counter[str]()
        self.sets = {"NSET": Sets(), "ELSET": Sets()}
        self.surfaces = defaultdict[str, list[IntArray]](list)
        # The sets that are no groups: those of the preprocessor.
        self._internal: set[str] = set()
        self._of_cards_of_nodes: set[str] = set()

    def add(self, card: Card) -> None:
        match card.keyword:
            case "NODE":
                self._add_nodes(card)
            case "ELEMENT":
                self._add_elements(card)
            case "NSET" | "ELSET":
                self._add_set(card)
            case "SURFACE":
                self._add_surface(card)

    def groups(self, kind: str) -> dict[str, IntArray]:
        """The cells, block after block, or the points of each set that a user has named."""
        sets = self.sets[kind]
        # The set of all nodes, which every preprocessor writes, is no part of the boundary.
        is_whole = {
            name for name in self._of_cards_of_nodes if len(sets.of(name)) == len(sets.numbers)
        }
        return sets.without([*self._internal, *(is_whole if kind == "NSET" else ())])

    def _number(self, kind: str, card: Card, numbers: list[int], first: int) -> None:
        """Number entities from ``first`` on, and put them into the set of their card."""
        places = range(first, first + len(numbers))
        self.sets[kind].numbers.update(zip(numbers, places, strict=True))
        if kind in card.options:
            self.sets[kind].of(card.name(kind)).extend(places)

    def _add_nodes(self, card: Card) -> None:
        if card.options.get("SYSTEM", "R").upper() != "R":
            raise ValueError("its coordinates are cylindrical or spherical; write Cartesian ones")
        points: FloatArray = np.zeros((len(card.rows), 3))
        for number, row in enumerate(card.rows):
            points[number, : len(row[1:4])] = [float(entry or 0.0) for entry in row[1:4]]
        self._number("NSET", card, [int(row[0]) for row in card.rows], len(self.points))
        self.points = np.concatenate([self.points, points])
        if "NSET" in card.options:
            self._of_cards_of_nodes.add(card.name("NSET"))

    def _add_elements(self, card: Card) -> None:
        kind = card.options["TYPE"].upper()
        count, dim = 0, 0
        if solid := _SOLID.match(kind):
            count, dim = int(solid[1]), 3
        elif plane := _PLANE.match(kind):
            count, dim = (6 if kind.startswith("STRI65") else int(plane[1])), 2
        if (dim, count) not in KINDS:
            # A line that ends with a comma goes on.
            self.left_out[kind] += sum(row[-1] != "" for row in card.rows)
            self._number("ELSET", card, [], 0)
            return
        # Number and nodes of each element, on one line or several; CalculiX writes more nodes.
        rows, row = list[list[int]](), list[int]()
        for entries in card.rows:
            row += [int(entry) for entry in entries if entry]
            if len(row) > count:
                rows.append(row[: count + 1])
                row = []
        if row or not rows:
            raise ValueError(f"an element of the type {card.options['TYPE']} takes {count} nodes")
        nodes = self.sets["NSET"].numbers
        try:
            corners = np.array([[nodes[number] for number in row[1:]] for row in rows])
        except KeyError as error:
            raise ValueError(f"node {error} of an element does not exist") from None
        first = sum(len(block.nodes) for block in self.blocks)
        self._number("ELSET", card, [row[0] for row in rows], first)
        self.blocks.append(Block(kind, dim, corners))

    def _add_set(self, card: Card) -> None:
        kind = card.keyword
        sets, name = self.sets[kind], card.name(kind)
        if "INTERNAL" in card.options:
            self._internal.add(name)
        members = sets.of(name)
        if "GENERATE" in card.options:
            for row in card.rows:
                first, last, step = ([int(entry) for entry in row if entry] + [1])[:3]
                every = range(first, last + 1, step)
                members += [sets.numbers[number] for number in every if number in sets.numbers]
        else:
            for entry in chain.from_iterable(card.rows):
                members += sets.named(card, entry)
        if kind == "NSET" and "ELSET" in card.options:
            cells = np.array(self.sets["ELSET"].named(card, card.options["ELSET"]), dtype=int)
            for block, inside in self.by_block(cells):
                members += [int(node) for node in np.unique(block.corners[inside])]

    def _add_surface(self, card: Card) -> None:
        name = card.name("NAME")
        if card.options.get("TYPE", "ELEMENT").upper() == "NODE":
            for row in card.rows:
                self.sets["NSET"].of(name).extend(self.sets["NSET"].named(card, row[0]))
            return
        facets = self.surfaces[name]
        for row in card.rows:
            cells = np.array(self.sets["ELSET"].named(card, row[0]), dtype=np.int64)
            side = _SIDE.fullmatch(row[1].upper() if len(row) > 1 else "")
            for block, inside in self.by_block(cells):
                sides = [] if block.kind is None else _SIDES.get(block.kind.name, ())
                if side is None and block.dim == 2:
                    facets.append(block.corners[inside])
                # Without a label these are all sides, of which those inside the body are left out.
                chosen = sides if side is None else sides[int(side[1]) - 1 : int(side[1])]
                facets += [block.nodes[inside][:, list(corners)] for corners in chosen]

    def by_block(self, cells: IntArray) -> Iterator[tuple[Block, IntArray]]:
        """Each block that has some of the cells (k,), with their places in it."""
        start = 0
        for block in self.blocks:
            inside = cells[(cells >= start) & (cells < start + len(block.nodes))] - start
            if len(inside):
                yield block, inside
            start += len(block.nodes)


def read(path: Path) -> MeshData:
    """The mesh of a deck, not checked yet; for one process.

    The cells of the highest dimension are the body, by their corners.  A region is named after the
    sets that its cells are in, joined by +; a set of all cells names those that are in no other
    set, which are else the region "body".  The parts of the boundary are the surfaces, the sets of
    cells of its dimension, and the sets of nodes: the facets with all their nodes in the set.

    Raises InputError for a file that cannot be read, and for cells that are not of one kind.
    """
    require_file(path)
    try:
        return _mesh(_deck(path))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _deck(path: Path) -> Deck:
    deck, cards = Deck(), list(_cards(path))
    _require_read(cards)
    # Sets may come before the elements that they name.
    for stage in (("NODE",), ("ELEMENT",), ("NSET", "ELSET"), ("SURFACE",)):
        for card in (card for card in cards if card.keyword in stage):
            try:
                deck.add(card)
            except (ValueError, KeyError, IndexError) as error:
                raise InputError(f"*{card.keyword} is wrong: {error}") from None
    return deck


def _mesh(deck: Deck) -> MeshData:
    dim = max((block.dim for block in deck.blocks), default=0)
    body = [block for block in deck.blocks if block.dim == dim > 1]
    kinds = {block.kind for block in body}
    kind = kinds.pop() if len(kinds) == 1 else None
    if kind is None:
        counts = Counter[str]()
        for block in body:
            counts[block.name] += len(block.nodes)
        listed = ", ".join(f"{count} {name}" for name, count in (counts or deck.left_out).items())
        raise InputError(
            f"it has the cells {listed or 'none'}; a body has cells of one kind: triangles, "
            "quadrilaterals, tetrahedra or hexahedra; mesh it again with one of them"
        )
    corners = np.concatenate([block.corners for block in body])
    numbers: IntArray = np.empty(len(deck.points), dtype=np.int64)
    for number, place in deck.sets["NSET"].numbers.items():
        numbers[place] = number
    cells = _regions(deck, dim, corners[:, list(kind.gmsh_order)])
    points = flat_points(deck.points, numbers, dim)
    mesh = MeshData(dim, points, numbers, cells, named_elements(kind.facet, {}))
    parts, empty = _parts(deck, CellFacets(mesh))
    findings = []
    if any(block.nodes.shape[1] > kind.corners for block in body):
        findings.append(Finding("mesh.second_order"))
    others = deck.left_out + Counter({b.name: len(b.nodes) for b in deck.blocks if b.dim < dim})
    if others:
        listed = ", ".join(f"{count} {name}" for name, count in sorted(others.items()))
        findings.append(Finding("mesh.other_elements", elements=listed, count=others.total()))
    if empty:
        findings.append(Finding("mesh.empty_sets", names=", ".join(empty)))
    return replace(mesh, facets=named_elements(kind.facet, parts), findings=tuple(findings))


def _regions(deck: Deck, dim: int, cells: IntArray) -> MeshElements:
    """The cells, each in a region."""
    is_cell = np.concatenate([np.full(len(b.nodes), b.dim == dim) for b in deck.blocks])
    has: dict[str, BoolArray] = {}
    for name, elements in deck.groups("ELSET").items():
        mark = np.zeros(len(is_cell), dtype=bool)
        mark[elements] = True
        if (mark & is_cell).any():
            has[name] = mark[is_cell]
    whole = next((name for name, inside in has.items() if inside.all()), "body")
    parted = {name: inside for name, inside in has.items() if not inside.all()}
    nothing = np.zeros(len(cells), dtype=bool)
    sets, region = np.unique(
        np.column_stack([nothing, *parted.values()]), axis=0, return_inverse=True
    )
    names = ["+".join(np.array(list(parted), dtype=str)[inside[1:]]) or whole for inside in sets]
    number_of = np.empty(len(is_cell), dtype=np.int64)
    for number, place in deck.sets["ELSET"].numbers.items():
        number_of[place] = number
    tags = {name: (tag,) for tag, name in enumerate(names, start=1)}
    return MeshElements(cells, number_of[is_cell], region.reshape(-1) + 1, tags)


def _parts(deck: Deck, body: CellFacets) -> tuple[dict[str, IntArray], list[str]]:
    """The facets of each part of the boundary, and the names of those that have none."""
    of = body.mesh.kind.facet
    _, boundary = body.with_cells(body.count == 1)

    def on_boundary(rows: Sequence[IntArray]) -> IntArray:
        facets = np.concatenate([boundary[:0], *(r for r in rows if r.shape[1] == of.corners)])
        number = body.find(facets)
        return facets[(number >= 0) & (body.count[number] == 1)]

    parts: dict[str, IntArray] = {}
    for name, nodes in deck.groups("NSET").items():
        inside = np.zeros(len(deck.points), dtype=bool)
        inside[nodes] = True
        parts[name] = boundary[inside[boundary].all(axis=1)]
    empty = [name for name, rows in parts.items() if not len(rows)]
    for name, cells in deck.groups("ELSET").items():
        blocks = deck.by_block(cells)
        rows = on_boundary([b.corners[inside] for b, inside in blocks if b.dim == of.dim])
        parts |= {name: rows} if len(rows) else {}
    # A surface says more than a set of its nodes.
    for name, sides in deck.surfaces.items():
        rows = on_boundary(sides)
        parts |= {name: rows} if len(rows) else {}
        empty += [] if len(rows) else [name]
    return {name: rows for name, rows in parts.items() if len(rows)}, empty
