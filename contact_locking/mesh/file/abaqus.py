"""Decks of Abaqus and CalculiX: nodes, elements, sets and surfaces, with parts and instances."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain, takewhile
from pathlib import Path

import numpy as np

from contact_locking.arrays import FloatArray, IntArray
from contact_locking.errors import InputError
from contact_locking.laws.rigid_motion import rotation
from contact_locking.mesh.file.foreign import KINDS, Block, ForeignMesh

# The types of elements with the number of their nodes: solids, and those of planes and shells.
_SOLID = re.compile(r"(?:DC3D|AC3D|C3D|SC)(\d+)")
_PLANE = re.compile(r"(?:CPS|CPEG|CPE|CGAX|CAX|DCAX|DC2D|M3D|R3D|STRI|S)(\d)")
# The corners of the sides S1, S2 and so on by the kind of the cell.
_EDGES = ((0, 1), (1, 2), (2, 3), (3, 0))
_FACES = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quadrilateral": _EDGES,
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


@dataclass
class Card:
    """A keyword with its options and its lines of data."""

    keyword: str
    options: dict[str, str]
    lines: list[str] = field(default_factory=list)

    @property
    def rows(self) -> list[list[str]]:
        """The entries of each line."""
        return [[entry.strip() for entry in line.split(",")] for line in self.lines]

    @property
    def entries(self) -> list[str]:
        return [entry for row in self.rows for entry in row if entry]


def read(source: Path) -> ForeignMesh:
    """The mesh of a deck.  Raises InputError for one that cannot be read."""
    deck = _Deck()
    cards = _placed(_cards(source))
    # Sets may come before the elements that they name.
    for stage in (("NODE",), ("ELEMENT",), ("NSET", "ELSET"), ("SURFACE",)):
        for instance, card in cards:
            if card.keyword in _GENERATORS:
                raise InputError(
                    f"{source}: *{card.keyword} makes nodes or elements of others, which is not "
                    "read; let the preprocessor write all of them"
                )
            if card.keyword in stage:
                try:
                    deck.add(instance, card)
                except (ValueError, KeyError, IndexError) as error:
                    raise InputError(f"{source}: *{card.keyword} is wrong: {error}") from None
    return deck.mesh()


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
    card: Card | None = None
    lines = map(str.strip, text.splitlines())
    for line in lines:
        if line.startswith("**") or not line:
            continue
        if not line.startswith("*"):
            if card is not None:
                card.lines.append(line)
            continue
        while line.endswith(","):
            line += next(lines, "")
        if card is not None:
            yield card
        head, *words = line[1:].split(",")
        pairs = (word.partition("=") for word in words)
        options = {name.strip().upper(): value.strip().strip('"') for name, _, value in pairs}
        card = Card(" ".join(head.upper().split()), options)
        if card.keyword == "INCLUDE":
            yield from _cards(path.parent / options.get("INPUT", ""), depth + 1)
    if card is not None:
        yield card


@dataclass(frozen=True)
class _Instance:
    """A copy of a part: where its nodes are, and the name of its own numbers and sets."""

    name: str = ""
    is_own: bool = False
    lines: tuple[tuple[float, ...], ...] = ()

    def place(self, points: FloatArray) -> FloatArray:
        if self.lines:
            points = points + np.asarray(self.lines[0][:3])
        if len(self.lines) > 1:
            start, end, angle = self.lines[1][:3], self.lines[1][3:6], self.lines[1][6]
            axis = np.subtract(end, start)
            turn = rotation(np.radians(angle) * axis / np.linalg.norm(axis))
            points = start + (points - start) @ turn.T
        return points


def _placed(cards: Iterable[Card]) -> list[tuple[_Instance, Card]]:
    """The cards with the instance whose numbers they take; a part without one stands as it is."""
    parts: dict[str, list[Card]] = {}
    used: set[str] = set()
    found: list[tuple[_Instance, Card]] = []
    stream = iter(cards)
    for card in stream:
        if card.keyword == "PART":
            of_part = takewhile(lambda one: one.keyword != "END PART", stream)
            parts[card.options["NAME"].upper()] = list(of_part)
        elif card.keyword == "INSTANCE":
            own = takewhile(lambda one: one.keyword != "END INSTANCE", stream)
            part = card.options.get("PART", "").upper()
            used.add(part)
            lines = tuple(tuple(map(float, filter(None, row))) for row in card.rows)
            instance = _Instance(card.options["NAME"], True, lines)
            found += [(instance, one) for one in chain(parts.get(part, []), own)]
        else:
            found.append((_Instance(card.options.get("INSTANCE", "")), card))
    for name, inside in parts.items():
        if name not in used:
            found += [(_Instance(name, True), one) for one in inside]
    return found


def _elements(card: Card, size: int) -> list[list[int]]:
    """Number and nodes of each element, on one line or several; CalculiX writes more nodes."""
    found: list[list[int]] = []
    row: list[int] = []
    for entries in card.rows:
        row += [int(entry) for entry in entries if entry]
        if len(row) >= size:
            found.append(row[:size])
            row = []
    if row or not found:
        raise ValueError(f"an element of the type {card.options['TYPE']} takes {size - 1} nodes")
    return found


class _Deck:
    """What the cards have told so far; nodes and elements are numbered in their order."""

    def __init__(self) -> None:
        self._points: list[FloatArray] = []
        self._count = 0
        # The nodes that were told of in the whole deck, and in each instance.
        self._size_of: Counter[str] = Counter()
        self._nodes: dict[str, dict[int, int]] = defaultdict(dict)
        self._elements: dict[str, dict[int, int]] = defaultdict(dict)
        self._blocks: list[Block] = []
        self._sets: dict[str, dict[Name, list[int]]] = {"NSET": {}, "ELSET": {}}
        self._facets: dict[Name, list[IntArray]] = {}
        self._spelled: dict[str, str] = {}
        self._internal: set[Name] = set()
        self._of_nodes: set[Name] = set()
        self._mesh = ForeignMesh(np.zeros((0, 3)), self._blocks)

    def add(self, instance: _Instance, card: Card) -> None:
        match card.keyword:
            case "NODE":
                self._add_nodes(instance, card)
            case "ELEMENT":
                self._add_elements(instance, card)
            case "NSET" | "ELSET":
                self._add_set(instance, card)
            case "SURFACE":
                self._add_surface(instance, card)

    def _name(self, instance: _Instance, word: str) -> Name:
        self._spelled.setdefault(word.upper(), word)
        return (instance.name.upper() if instance.is_own else "", word.upper())

    def _add_nodes(self, instance: _Instance, card: Card) -> None:
        if card.options.get("SYSTEM", "R").upper() != "R":
            raise ValueError("its coordinates are cylindrical or spherical; write Cartesian ones")
        numbers = [int(row[0]) for row in card.rows]
        points = np.zeros((len(numbers), 3))
        for point, row in zip(points, card.rows, strict=True):
            given = [float(entry or 0.0) for entry in row[1:4]]
            point[: len(given)] = given
        self._points.append(instance.place(points))
        places = range(self._count, self._count + len(numbers))
        self._nodes[instance.name.upper()].update(zip(numbers, places, strict=True))
        self._count += len(numbers)
        self._size_of[self._name(instance, "")[0]] += len(numbers)
        if "NSET" in card.options:
            name = self._name(instance, card.options["NSET"])
            self._of_nodes.add(name)
            self._extend("NSET", name, places)

    def _add_elements(self, instance: _Instance, card: Card) -> None:
        kind = card.options["TYPE"].upper()
        count, dim = 0, 0
        if solid := _SOLID.match(kind):
            count, dim = int(solid[1]), 3
        elif plane := _PLANE.match(kind):
            count, dim = (6 if kind.startswith("STRI65") else int(plane[1])), 2
        numbers: list[int] = []
        first = sum(len(block.nodes) for block in self._blocks)
        if (dim, count) in KINDS:
            rows = _elements(card, count + 1)
            nodes, numbers = self._nodes[instance.name.upper()], [row[0] for row in rows]
            try:
                found = np.array([[nodes[number] for number in row[1:]] for row in rows])
            except KeyError as error:
                raise ValueError(f"node {error} of an element is not there") from None
            self._blocks.append(Block(kind, dim, found))
        else:
            # A line that ends with a comma goes on.
            ends = sum(not line.endswith(",") for line in card.lines)
            self._mesh.left_out[kind] += ends
        places = range(first, first + len(numbers))
        self._elements[instance.name.upper()].update(zip(numbers, places, strict=True))
        if "ELSET" in card.options:
            self._extend("ELSET", self._name(instance, card.options["ELSET"]), places)

    def _extend(self, kind: str, name: Name, members: Iterable[int]) -> None:
        self._sets[kind].setdefault(name, []).extend(members)

    def _add_set(self, instance: _Instance, card: Card) -> None:
        kind = card.keyword
        name = self._name(instance, card.options[kind])
        if "INTERNAL" in card.options:
            self._internal.add(name)
        members: list[int] = []
        if "GENERATE" in card.options:
            numbers = self._numbers(kind, instance)
            for row in card.rows:
                first, last, step = ([int(entry) for entry in row if entry] + [1])[:3]
                every = range(first, last + 1, step)
                members += [numbers[number] for number in every if number in numbers]
        else:
            for entry in card.entries:
                members += self._members(kind, instance, entry)
        if kind == "NSET" and "ELSET" in card.options:
            cells = np.array(self._members("ELSET", instance, card.options["ELSET"]), dtype=int)
            for block, inside in self._by_block(cells):
                members += [int(node) for node in np.unique(block.corners[inside])]
        self._extend(kind, name, members)

    def _numbers(self, kind: str, instance: _Instance) -> dict[int, int]:
        return (self._nodes if kind == "NSET" else self._elements)[instance.name.upper()]

    def _members(self, kind: str, instance: _Instance, entry: str) -> list[int]:
        """The members that an entry of a set names: a number, a set, or INSTANCE.NUMBER."""
        scope, _, word = entry.strip('"').upper().rpartition(".")
        there = _Instance(scope) if scope else instance
        if word.isdecimal():
            number = self._numbers(kind, there).get(int(word))
            return [] if number is None else [number]
        names = ((there.name.upper(), word), ("", word), ("", entry.upper()))
        sets = self._sets[kind]
        return next((sets[name] for name in names if name in sets), [])

    def _by_block(self, cells: IntArray) -> Iterator[tuple[Block, IntArray]]:
        """Each block that has some of the cells (k,), with their places in it."""
        start = 0
        for block in self._blocks:
            inside = cells[(cells >= start) & (cells < start + len(block.nodes))] - start
            if len(inside):
                yield block, inside
            start += len(block.nodes)

    def _add_surface(self, instance: _Instance, card: Card) -> None:
        name = self._name(instance, card.options["NAME"])
        if card.options.get("TYPE", "ELEMENT").upper() == "NODE":
            for entry in (row[0] for row in card.rows):
                self._extend("NSET", name, self._members("NSET", instance, entry))
            return
        facets = self._facets.setdefault(name, [])
        for row in card.rows:
            cells = np.array(self._members("ELSET", instance, row[0]), dtype=np.int64)
            side = _SIDE.fullmatch(row[1].upper() if len(row) > 1 else "")
            for block, inside in self._by_block(cells):
                sides = [] if block.kind is None else _FACES.get(block.kind.name, ())
                if side is None and block.dim == 2:
                    facets.append(block.corners[inside])
                # Without a label these are all sides, of which those inside the body are left out.
                chosen = sides if side is None else sides[int(side[1]) - 1 : int(side[1])]
                facets += [block.nodes[inside][:, list(corners)] for corners in chosen]

    def mesh(self) -> ForeignMesh:
        """The mesh, with the names of sets as they are spelled, and of an instance if need be."""
        mesh = self._mesh
        mesh.points = np.concatenate([np.zeros((0, 3)), *self._points])
        for sets, found in (
            (self._sets["ELSET"], mesh.cell_sets),
            (self._sets["NSET"], mesh.point_sets),
        ):
            for name, members in sets.items():
                # The set of all nodes, which every preprocessor writes, is no part of the boundary.
                is_whole = name in self._of_nodes and len(members) == self._size_of[name[0]]
                if name not in self._internal and not is_whole:
                    found[self._shown(name, sets)] = np.unique(np.array(members, dtype=np.int64))
        for name, facets in self._facets.items():
            mesh.facet_sets[self._shown(name, self._facets)] = facets
        return mesh

    def _shown(self, name: Name, sets: Iterable[Name]) -> str:
        scope, word = name
        spelled = self._spelled[word]
        is_alone = sum(other == word for _, other in sets) == 1
        return spelled if is_alone or not scope else f"{scope}.{spelled}"
