"""Decks of Abaqus and CalculiX, with parts and instances, written as Gmsh files.

Sets of cells become regions; sets of nodes, surfaces and sets of facets parts of the boundary.
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, takewhile
from pathlib import Path

import numpy as np

from contact_locking.arrays import BoolArray, FloatArray, IntArray
from contact_locking.errors import InputError, explained
from contact_locking.files.atomic import staging
from contact_locking.findings import Finding
from contact_locking.laws.rigid_motion import rotation
from contact_locking.mesh.cell_kind import (
    HEXAHEDRON,
    QUADRILATERAL,
    TETRAHEDRON,
    TRIANGLE,
    CellKind,
    keys,
)
from contact_locking.meshes.geometry import check_complete, empty_model

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

# The names of sets are those of an instance, or of the whole deck.
Name = tuple[str, str]


@dataclass(frozen=True)
class Card:
    """A keyword with its options and its lines of data.

    ``scope`` is the instance whose numbers of nodes and elements it has, empty for the deck, and
    ``is_inside`` says that it stands in the instance, so that sets belong to it.  ``place`` are the
    lines of data of the instance: a translation, and two points of an axis with an angle.
    """

    keyword: str
    options: dict[str, str]
    lines: list[str] = field(default_factory=list)
    scope: str = ""
    is_inside: bool = False
    place: tuple[tuple[float, ...], ...] = ()

    @property
    def rows(self) -> list[list[str]]:
        """The entries of each line."""
        return [[entry.strip() for entry in line.split(",")] for line in self.lines]

    def name(self, word: str) -> Name:
        return (self.scope if self.is_inside else "", word.upper())


def read(source: Path) -> Deck:
    """The data of a deck.  Raises InputError for one that cannot be read."""
    deck = Deck()
    cards = _of_instances(_cards(source))
    for keyword in (card.keyword for card in cards if card.keyword in _GENERATORS):
        raise InputError(
            f"{source}: *{keyword} makes nodes or elements of others, which is not read; let the "
            "preprocessor write all of them"
        )
    # Sets may come before the elements that they name.
    for stage in (("NODE",), ("ELEMENT",), ("NSET", "ELSET"), ("SURFACE",)):
        for card in (card for card in cards if card.keyword in stage):
            try:
                deck.add(card)
            except (ValueError, KeyError, IndexError) as error:
                raise InputError(f"{source}: *{card.keyword} is wrong: {error}") from None
    return deck


def _cards(path: Path, depth: int = 0) -> Iterator[Card]:
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
        data = []
        yield (card := Card(" ".join(head.upper().split()), options, data))
        if card.keyword == "INCLUDE":
            yield from _cards(path.parent / options.get("INPUT", ""), depth + 1)


def _of_instances(cards: Iterable[Card]) -> list[Card]:
    """The cards with the instance whose numbers they take; a part without one stands as it is."""
    parts: dict[str, list[Card]] = {}
    used: set[str] = set()
    scoped: list[Card] = []
    stream = iter(cards)

    def until(end: str) -> list[Card]:
        return list(takewhile(lambda card: card.keyword != end, stream))

    for card in stream:
        name = card.options.get("NAME", "").upper()
        if card.keyword == "PART":
            parts[name] = until("END PART")
        elif card.keyword == "INSTANCE":
            inside, name_of = until("END INSTANCE"), card.options.get("PART", "").upper()
            used.add(name_of)
            place = tuple(tuple(map(float, filter(None, row))) for row in card.rows)
            scoped += [
                replace(entry, scope=name, is_inside=True, place=place)
                for entry in chain(parts.get(name_of, []), inside)
            ]
        else:
            scoped.append(replace(card, scope=card.options.get("INSTANCE", "").upper()))
    for name in parts.keys() - used:
        scoped += [replace(card, scope=name, is_inside=True) for card in parts[name]]
    return scoped


class Deck:
    """The data of the cards read so far; nodes and elements are numbered in their order.

    ``points`` (m, 3) are the nodes, ``blocks`` the cells, and ``left_out`` counts the elements that
    are no cells, such as springs.
    """

    def __init__(self) -> None:
        self.points: FloatArray = np.zeros((0, 3))
        self.blocks, self.left_out = list[Block](), Counter[str]()
        # Nodes and elements by the numbers in the deck, of each instance, and the sets of these.
        self._numbers = {kind: defaultdict[str, dict[int, int]](dict) for kind in ("NSET", "ELSET")}
        self._sets = {kind: defaultdict[Name, list[int]](list) for kind in ("NSET", "ELSET")}
        self._facets = defaultdict[Name, list[IntArray]](list)
        self._spelled: dict[str, str] = {}
        # The sets that are no groups: those of the preprocessor, and those of all nodes.
        self._internal: set[Name] = set()
        self._of_cards_of_nodes: set[Name] = set()

    def add(self, card: Card) -> None:
        for word in card.options.values():
            self._spelled.setdefault(word.upper(), word)
        match card.keyword:
            case "NODE":
                self._add_nodes(card)
            case "ELEMENT":
                self._add_elements(card)
            case "NSET" | "ELSET":
                self._add_set(card)
            case "SURFACE":
                self._add_surface(card)

    def _number(self, kind: str, card: Card, numbers: list[int], first: int) -> None:
        """Number entities from ``first`` on, and put them into the set of their card."""
        places = range(first, first + len(numbers))
        self._numbers[kind][card.scope].update(zip(numbers, places, strict=True))
        if kind in card.options:
            self._sets[kind][card.name(card.options[kind])].extend(places)

    def _add_nodes(self, card: Card) -> None:
        if card.options.get("SYSTEM", "R").upper() != "R":
            raise ValueError("its coordinates are cylindrical or spherical; write Cartesian ones")
        points: FloatArray = np.zeros((len(card.rows), 3))
        for number, row in enumerate(card.rows):
            points[number, : len(row[1:4])] = [float(entry or 0.0) for entry in row[1:4]]
        if card.place:
            points = points + np.asarray(card.place[0][:3])
        if len(card.place) > 1:
            start, end, angle = card.place[1][:3], card.place[1][3:6], card.place[1][6]
            axis = np.subtract(end, start)
            turn = rotation(np.radians(angle) * axis / np.linalg.norm(axis))
            points = start + (points - start) @ turn.T
        self._number("NSET", card, [int(row[0]) for row in card.rows], len(self.points))
        self.points = np.concatenate([self.points, points])
        if "NSET" in card.options:
            self._of_cards_of_nodes.add(card.name(card.options["NSET"]))

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
        nodes = self._numbers["NSET"][card.scope]
        try:
            corners = np.array([[nodes[number] for number in row[1:]] for row in rows])
        except KeyError as error:
            raise ValueError(f"node {error} of an element is not there") from None
        self._number(
            "ELSET", card, [row[0] for row in rows], sum(len(block.nodes) for block in self.blocks)
        )
        self.blocks.append(Block(kind, dim, corners))

    def _add_set(self, card: Card) -> None:
        kind = card.keyword
        name = card.name(card.options[kind])
        if "INTERNAL" in card.options:
            self._internal.add(name)
        members = self._sets[kind][name]
        if "GENERATE" in card.options:
            numbers = self._numbers[kind][card.scope]
            for row in card.rows:
                first, last, step = ([int(entry) for entry in row if entry] + [1])[:3]
                every = range(first, last + 1, step)
                members += [numbers[number] for number in every if number in numbers]
        else:
            for entry in chain.from_iterable(card.rows):
                members += self._members(kind, card, entry)
        if kind == "NSET" and "ELSET" in card.options:
            cells = np.array(self._members("ELSET", card, card.options["ELSET"]), dtype=int)
            for block, inside in self.by_block(cells):
                members += [int(node) for node in np.unique(block.corners[inside])]

    def _members(self, kind: str, card: Card, entry: str) -> list[int]:
        """The members that an entry of a set names: a number, a set, or INSTANCE.NUMBER."""
        scope, _, word = entry.strip('"').upper().rpartition(".")
        scope = scope or card.scope
        if word.isdecimal():
            number = self._numbers[kind][scope].get(int(word))
            return [] if number is None else [number]
        sets = self._sets[kind]
        return next(
            (sets[x] for x in ((scope, word), ("", word), ("", entry.upper())) if x in sets), []
        )

    def by_block(self, cells: IntArray) -> Iterator[tuple[Block, IntArray]]:
        """Each block that has some of the cells (k,), with their places in it."""
        start = 0
        for block in self.blocks:
            inside = cells[(cells >= start) & (cells < start + len(block.nodes))] - start
            if len(inside):
                yield block, inside
            start += len(block.nodes)

    def _add_surface(self, card: Card) -> None:
        name = card.name(card.options["NAME"])
        if card.options.get("TYPE", "ELEMENT").upper() == "NODE":
            for row in card.rows:
                self._sets["NSET"][name] += self._members("NSET", card, row[0])
            return
        facets = self._facets[name]
        for row in card.rows:
            cells = np.array(self._members("ELSET", card, row[0]), dtype=np.int64)
            side = _SIDE.fullmatch(row[1].upper() if len(row) > 1 else "")
            for block, inside in self.by_block(cells):
                sides = [] if block.kind is None else _SIDES.get(block.kind.name, ())
                if side is None and block.dim == 2:
                    facets.append(block.corners[inside])
                # Without a label these are all sides, of which those inside the body are left out.
                chosen = sides if side is None else sides[int(side[1]) - 1 : int(side[1])]
                facets += [block.nodes[inside][:, list(corners)] for corners in chosen]

    def sets(self, kind: str) -> dict[str, IntArray]:
        """The numbers of cells, block after block, or of points in sets, by their names."""
        sets = self._sets[kind]
        # The set of all nodes, which every preprocessor writes, is no part of the boundary.
        whole = {
            name
            for name in self._of_cards_of_nodes
            if kind == "NSET" and len(sets[name]) == len(self._numbers[kind][name[0]])
        }
        return {
            self._shown(name, sets): np.unique(np.array(members, dtype=np.int64))
            for name, members in sets.items()
            if name not in self._internal | whole
        }

    def surfaces(self) -> dict[str, list[IntArray]]:
        """The facets (f, c) of surfaces by their corners, by the names of the surfaces."""
        return {self._shown(name, self._facets): rows for name, rows in self._facets.items()}

    def _shown(self, name: Name, sets: Iterable[Name]) -> str:
        """The name of a set as it is spelled, with that of the instance if need be."""
        is_alone = sum(word == name[1] for _, word in sets) == 1
        prefix = "" if is_alone or not name[0] else f"{name[0]}."
        return prefix + self._spelled[name[1]]


#: The endings of decks.
ENDINGS = (".inp",)

#: A kind of elements, the name of a group, and its elements (k, c) by their corners.
Group = tuple[CellKind, str, IntArray]


def convert(source: Path, target: Path) -> list[Finding]:
    """Write the mesh of the deck ``source`` as a Gmsh file; returns findings.

    The cells of the highest dimension are the body, by their corners.  A region is named after the
    sets that its cells are in, joined by +; a set of all cells names those that are in no other
    set, which are else the region "body".  The parts of the boundary are the surfaces, the sets of
    cells of its dimension, and the sets of nodes: the facets with all their nodes in the set.

    Raises InputError for a file that cannot be read, and for cells that are not of one kind.
    """
    if not source.is_file():
        raise InputError(f"there is no such file: {source}")
    deck = read(source)
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
            f"{source} has the cells {listed or 'none'}; a body has cells of one kind: triangles, "
            "quadrilaterals, tetrahedra or hexahedra; mesh it again with one of them"
        )
    cells = np.concatenate([block.corners for block in body])
    regions = _regions(deck, kind, cells)
    parts, empty = _parts(deck, kind, cells)
    names = {name for _, name, _ in regions}
    parts = [(of, f"{name} (nodes)" if name in names else name, x) for of, name, x in parts]
    _write(target, deck.points, cells, [*regions, *parts])
    findings = []
    if any(block.nodes.shape[1] > kind.corners for block in body):
        findings.append(Finding("mesh.second_order"))
    others = deck.left_out + Counter({b.name: len(b.nodes) for b in deck.blocks if b.dim < dim})
    if others:
        listed = ", ".join(f"{count} {name}" for name, count in sorted(others.items()))
        findings.append(Finding("mesh.other_elements", elements=listed, count=others.total()))
    if empty:
        findings.append(Finding("mesh.empty_sets", names=", ".join(empty)))
    return [finding.at(str(source)) for finding in findings]


def _regions(deck: Deck, kind: CellKind, cells: IntArray) -> list[Group]:
    """The cells of each region."""
    is_cell = np.concatenate([np.full(len(b.nodes), b.dim == kind.dim) for b in deck.blocks])
    has: dict[str, BoolArray] = {}
    for name, elements in deck.sets("ELSET").items():
        mark = np.zeros(len(is_cell), dtype=bool)
        mark[elements] = True
        if (mark & is_cell).any():
            has[name] = mark[is_cell]
    whole = next((name for name, inside in has.items() if inside.all()), "body")
    parted = {name: inside for name, inside in has.items() if not inside.all()}
    nothing = np.zeros(len(cells), dtype=bool)
    sets, number = np.unique(
        np.column_stack([nothing, *parted.values()]), axis=0, return_inverse=True
    )
    names = ["+".join(np.array(list(parted), dtype=str)[inside[1:]]) or whole for inside in sets]
    return [(kind, name, cells[number.reshape(-1) == k]) for k, name in enumerate(names)]


def _parts(deck: Deck, kind: CellKind, cells: IntArray) -> tuple[list[Group], list[str]]:
    """The facets of each part of the boundary, and the names of those that have none."""
    count, of = len(deck.points), kind.facet
    every = kind.facets_of(cells[:, list(kind.gmsh_order)])[:, list(of.gmsh_order)]
    _, first, counts = np.unique(
        keys(np.sort(every, axis=1), count), return_index=True, return_counts=True
    )
    facets = every[first[counts == 1]]
    boundary = keys(np.sort(facets, axis=1), count)

    def on_boundary(rows: Sequence[IntArray]) -> IntArray:
        fitting = [np.sort(some, axis=1) for some in rows if some.shape[1] == of.corners]
        known = [keys(some, count) for some in fitting if len(some)]
        return facets[np.isin(boundary, np.concatenate(known))] if known else facets[:0]

    groups: dict[str, IntArray] = {}
    empty = []
    for name, nodes in deck.sets("NSET").items():
        inside = np.zeros(count, dtype=bool)
        inside[nodes] = True
        groups[name] = facets[inside[facets].all(axis=1)]
        if len(nodes) and not len(groups[name]):
            empty.append(name)
    for name, cells_of_set in deck.sets("ELSET").items():
        blocks = deck.by_block(cells_of_set)
        chosen = [block.corners[inside] for block, inside in blocks if block.dim == of.dim]
        if len(rows := on_boundary(chosen)):
            groups[name] = rows
    # A surface says more than a set of its nodes.
    for name, sides in deck.surfaces().items():
        if len(rows := on_boundary(sides)):
            groups[name] = rows
        else:
            empty.append(name)
    return [(of, name, rows) for name, rows in groups.items() if len(rows)], empty


def _write(target: Path, points: FloatArray, cells: IntArray, groups: Sequence[Group]) -> None:
    import gmsh

    used = np.unique(cells)
    place = np.zeros(len(points), dtype=np.int64)
    place[used] = np.arange(1, len(used) + 1)
    with explained(f"cannot write {target}", target), staging(target.parent) as folder:
        path = folder / "mesh.msh"
        path.touch()
        with empty_model() as model:
            # Numbers in text form would lose a digit.
            gmsh.option.setNumber("Mesh.Binary", 1)
            for number, (of, name, rows) in enumerate(groups, start=1):
                model.addDiscreteEntity(of.dim, number)
                if number == 1:
                    model.mesh.addNodes(of.dim, 1, place[used], points[used].reshape(-1))
                model.mesh.addElementsByType(number, of.gmsh, [], place[rows].reshape(-1))
                model.addPhysicalGroup(of.dim, [number], number, name.replace('"', "'"))
            gmsh.write(str(path))
        check_complete(path)
        path.replace(target)
