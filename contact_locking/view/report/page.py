"""What pages are made of: charts with named curves, embedded pictures, templates of HTML, words.

A page needs no other file: its style and its pictures are inside.  Values, keys and quantities
stand as a person writes them: ``friction coefficient μ``.
"""

from __future__ import annotations

import base64
import functools
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import matplotlib
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

from contact_locking._version import __version__
from contact_locking.arrays import AXES, FloatArray
from contact_locking.results.quantities import QUANTITIES, look_up
from contact_locking.view.pictures import style


def shown(value: Any) -> str:
    """The text of a value: four digits, a power of ten as a superscript, infinity as a sign."""
    match value:
        case None:
            return "\N{EN DASH}"
        case bool():
            return "yes" if value else "no"
        case int() if abs(value) < 10**15:
            digits = f"{value:,}".replace(",", "\N{THIN SPACE}")
            return digits.replace("-", "\N{MINUS SIGN}")
        case int() | float() if abs(value) < 1e308:
            return _number(float(value))
        case int() | float():
            if value != value:
                return "not a number"
            return "\N{INFINITY}" if value > 0 else "\N{MINUS SIGN}\N{INFINITY}"
        case "inf":
            return "\N{INFINITY}"
        case list():
            return "(" + ", ".join(map(shown, _without_rounding(value))) + ")"
        case dict():
            return ", ".join(f"{key}: {shown(entry)}" for key, entry in value.items())
    return str(value)


def _without_rounding(vector: list[Any]) -> list[Any]:
    """The vector with zero for components that rounding alone keeps from zero."""
    if not vector or not all(isinstance(number, float) for number in vector):
        return vector
    largest = max(map(abs, vector))
    return [0.0 if abs(number) < 1e-12 * largest else number for number in vector]


def _number(value: float) -> str:
    """Four digits, and a power of ten as a superscript: 1.2x10^-5 for 1.2e-05."""
    mantissa, _, exponent = f"{value + 0.0:.4g}".replace("-", "\N{MINUS SIGN}").partition("e")
    if not exponent:
        return mantissa
    power = exponent.lstrip("+").replace("\N{MINUS SIGN}", "-")
    raised = str(int(power)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"10{raised}" if mantissa == "1" else f"{mantissa}\N{MULTIPLICATION SIGN}10{raised}"


_TITLES: Mapping[str, str] = {
    "friction.coefficient": "friction coefficient μ",
    "friction.regularisation": "regularisation δ",
    "friction.smoothing.kernel": "smoothing kernel",
    "friction.smoothing.radius": "smoothing radius r",
    "material.elasticity.poisson": "Poisson's ratio ν",
    "material.elasticity.young": "Young's modulus E",
    "material.locking_limit": "strain limit M",
    "mesh.h": "element size h",
    "mesh.h_contact": "element size at the contact",
    "penalty.epsilon": "compliance ε",
    "penalty.n": "penalty n",
    "solver.method": "solver",
    "dofs": "unknowns",
    "dolfinx": "DOLFINx",
    "iterations.friction": "friction updates",
    "iterations.linear": "linear solves",
}
# The names of values of a certificate and of stages that are not their keys with blanks.
_WORDS: Mapping[str, str] = {
    "alpha": "α",
    "c_0": "c_0",
    "c_0_reason": "why c_0 is not known",
    "epsilon": "ε",
}
# Sections whose names say nothing beside that of the key below them.
_OMITTED = ("mesh", "material", "loads", "solver", "certificate", "output")


def title(key: str) -> str:
    """The name of a dotted key of a study file or of a summary.

    The last number of the key of a vector becomes the name of an axis.
    """
    if key in QUANTITIES:
        return QUANTITIES[key].name
    if key in _TITLES:
        return _TITLES[key]
    if (of_contact := re.fullmatch(r"contacts\.([^.]+)\.(.+)", key)) is not None:
        return f"{title(of_contact[2])} on {of_contact[1]}"
    above, _, last = key.rpartition(".")
    if last.isdecimal() and int(last) < len(AXES):
        of = above.removesuffix("_at")
        if of in QUANTITIES:
            place = f", {QUANTITIES[of].at}" if of != above else ""
            return f"{QUANTITIES[of].name}{place}, {AXES[int(last)]}"
    words = [word for word in key.split(".") if word not in _OMITTED] or [key]
    return " ".join(words).replace("_", " ")


def titles_in(keys: Sequence[str], data: Any) -> dict[str, str]:
    """The names of keys by key, with the boundary parts that the data of a study file names.

    Such as ``traction on top, y`` for ``loads.tractions.0.value.1``.
    """
    titles = [_title_in(key.split("."), data) for key in keys]
    return dict(zip(keys, titles if len(set(titles)) == len(titles) else keys, strict=True))


def _title_in(parts: list[str], data: Any) -> str:
    *above, last = parts
    entry = look_up(data, ".".join(above))
    if last.isdecimal() and isinstance(entry, list) and not any(isinstance(e, dict) for e in entry):
        axis = AXES[int(last)] if int(last) < len(AXES) else last
        return f"{_title_in(above, data)}, {axis}"
    match parts:
        case ["loads", kind, index, *rest] if index.isdecimal() and kind.endswith("s"):
            what = " ".join([kind.removesuffix("s"), *(word for word in rest if word != "value")])
            return f"{what} on {_on(data, parts[:2], index)}".replace("_", " ")
        case ["contact", index, *rest] if index.isdecimal() and rest:
            what = _title_in(["contact", *rest], data)
            return f"{what} on {_on(data, parts[:1], index)}"
    return title(".".join(parts))


def _on(data: Any, place: list[str], index: str) -> str:
    """The boundary parts of an entry of a list, its number if it names none."""
    on = look_up(data, ".".join([*place, index, "on"]))
    return ", ".join(map(str, on)) if isinstance(on, list) else str(on or index)


def words(name: str) -> str:
    """The name of a value of a certificate, which may be dotted, or of a stage."""
    return _WORDS.get(name) or name.replace(".", ", ").replace("_", " ")


# About the width of a phone, on which the text has to stay readable.
WIDTH = 4.4
_RC: dict[str, Any] = {
    **style.RC,
    "figure.constrained_layout.use": True,
    "svg.fonttype": "path",
    "text.color": style.BLACK,
    "axes.labelcolor": style.BLACK,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "xtick.color": style.BLACK,
    "ytick.color": style.BLACK,
    "axes.formatter.use_mathtext": True,
}


@dataclass(frozen=True)
class Chart:
    """A chart with the name of its files and a description for readers who do not see it."""

    name: str
    description: str
    svg: str
    png: bytes

    def inline(self) -> Markup:
        """The SVG element without its size."""
        opening, _, inside = self.svg[self.svg.index("<svg") :].partition(">")
        (box,) = re.findall(r'viewBox="[^"]*"', opening)
        inside = re.sub(r"<metadata>.*?</metadata>", "", inside, count=1, flags=re.DOTALL)
        head = f'<svg {box} role="img" xmlns:xlink="http://www.w3.org/1999/xlink">'
        label = Markup("<title>{}</title>").format(self.description)
        return Markup(head) + label + Markup(inside)


@contextmanager
def drawn(charts: list[Chart], name: str, description: str, height: float) -> Iterator[Figure]:
    """A figure of the common width, which joins the ``charts`` when the block has filled it."""
    # The salt makes the identifiers of a chart differ from those of other charts on the page.
    with matplotlib.rc_context(_RC | {"svg.hashsalt": name}):
        figure = Figure(figsize=(WIDTH, height))
        yield figure
        svg, png = _rendered(figure)
    charts.append(Chart(name, description, svg, png))


def _rendered(drawing: Figure) -> tuple[str, bytes]:
    svg, png = io.StringIO(), io.BytesIO()
    FigureCanvasSVG(drawing).print_svg(svg, metadata={"Date": None, "Creator": None})
    FigureCanvasAgg(drawing)
    drawing.savefig(png, format="png", dpi=style.DPI, facecolor="white")
    return svg.getvalue(), png.getvalue()


_COLOURS = (style.BLUE, style.VERMILION, "#009E73", "#CC79A7", style.ORANGE, style.SKY)
_MARKS = "osD^vP"
# The most curves that a legend names; of more curves it names some.
_MOST_NAMED = 12


@dataclass(frozen=True)
class Curve:
    """Values y over finite x, ascending in trends; ``limit`` is the value at x = inf.

    ``label`` names the other keys with their values.
    """

    label: str
    x: FloatArray
    y: FloatArray
    limit: float | None = None


def gridded(figure: Figure, x_label: str, y_label: str) -> Axes:
    """New axes with a pale grid behind the curves."""
    axes = figure.add_subplot(xlabel=x_label, ylabel=y_label)
    axes.grid(color=style.PALE, lw=0.6)
    axes.set_axisbelow(True)
    return axes


def drawing(curves: Sequence[Curve], label: str) -> dict[str, Any]:
    """The colour and the mark of a curve, the same in all charts of these curves."""
    labels = [curve.label for curve in curves]
    number, count = labels.index(label), len(labels)
    scale = matplotlib.colormaps["viridis"]
    colour: Any = _COLOURS[number] if count <= len(_COLOURS) else scale(0.93 * number / count)
    mark = _MARKS[number % len(_MARKS)]
    return {"color": colour, "lw": 1.4, "marker": mark, "ms": 4.0}


def name_curves(figure: Figure) -> None:
    """Name the curves in a legend above the axes, of many curves some."""
    pairs = zip(*figure.axes[0].get_legend_handles_labels(), strict=True)
    named = [(handle, label) for handle, label in pairs if label]
    if named:
        some = named[:: -(-len(named) // _MOST_NAMED)]
        figure.legend(*zip(*some, strict=True), loc="outside upper left")


def legend_height(count: int) -> float:
    """The height of the legend of so many curves, in inches."""
    return 0.19 * min(count, _MOST_NAMED)


def plain(text: str) -> str:
    """A text without formulas for Matplotlib, short enough for a narrow chart."""
    short = text if len(text) <= 60 else f"{text[:59]}…"
    return short.replace("$", r"\$")


def embedded(path: Path, width: int, colours: int | None = None) -> str:
    """A picture of at most a width as a data URI, with fewer ``colours`` if they are given."""
    with Image.open(path) as opened:
        image: Image.Image = opened.convert("RGB")
    if image.width > width:
        size = (width, max(1, round(image.height * width / image.width)))
        image = image.resize(size, Image.Resampling.LANCZOS)
    if colours is not None:
        image = image.quantize(colours)
    stream = io.BytesIO()
    image.save(stream, format="PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"


def render(template: str, **context: Any) -> str:
    """A whole HTML document from a template of this package."""
    look = resources.files(__package__).joinpath("page.css").read_text(encoding="utf-8")
    page = environment().get_template(template)
    return page.render(context, version=__version__, style=Markup(look))


@functools.cache
def environment() -> Environment:
    """The templates of this package, compiled once, with filters for values, keys and formulas."""
    made = Environment(
        loader=PackageLoader(str(__package__), "."),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters |= {"shown": shown, "key": key, "formula": formula, "title": title, "words": words}
    return made


def key(name: str) -> Markup:
    """A dotted key as code; a line may break after a dot or an underscore."""
    broken = re.sub(r"(?<=[._])(?=.)", "<wbr>", str(escape(name)))
    return Markup(f"<code>{broken}</code>")


def formula(text: str) -> Markup:
    """A text whose indices of one letter are set as indices: the C in Gamma_C."""
    return Markup(re.sub(r"_(\w)", r"<sub>\1</sub>", str(escape(text))))
