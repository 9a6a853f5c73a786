"""What pages are made of: charts with named curves, embedded pictures, templates of HTML.

A page needs no other file: its style, script and pictures are inside.
"""

from __future__ import annotations

import base64
import functools
import hashlib
import io
import re
from collections.abc import Callable, Sequence
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
from contact_locking.arrays import FloatArray
from contact_locking.view.pictures import style

from .words import shown, title, words

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


def chart(
    name: str, description: str, height: float, draw: Callable[..., None], *arguments: Any
) -> Chart:
    """The rendered figure of the common width, which ``draw(figure, *arguments)`` fills."""
    # The salt makes the identifiers of a chart differ from those of other charts on the page.
    with matplotlib.rc_context(_RC | {"svg.hashsalt": name}):
        drawing = Figure(figsize=(WIDTH, height))
        draw(drawing, *arguments)
        svg, png = _rendered(drawing)
    return Chart(name, description, svg, png)


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
    script = _resource("page.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    look = {"style": Markup(_resource("page.css")), "script": Markup(script)}
    page = environment().get_template(template)
    return page.render(context, version=__version__, script_digest=digest, **look)


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


def _resource(name: str) -> str:
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")
