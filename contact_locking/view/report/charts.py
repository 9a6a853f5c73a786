"""Charts as files, and inside the page, whose colours they take."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
from markupsafe import Markup
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from contact_locking.view.pictures import style

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
# Colours of the charts for which the page has variables, in its light and its dark scheme.
_TEXT_COLOURS = {style.BLACK: "--ink", style.RC["axes.edgecolor"]: "--axis"}
_COLOURS = {
    colour.lower(): name
    for colour, name in {
        **_TEXT_COLOURS,
        style.PALE: "--pale",
        style.BLUE: "--blue",
        style.VERMILION: "--vermilion",
    }.items()
}


@dataclass(frozen=True)
class Chart:
    """A chart with the name of its files and a description for readers who do not see it."""

    name: str
    description: str
    svg: str
    png: bytes

    def write(self, folder: Path) -> None:
        """``NAME.svg`` and ``NAME.png``. Raises OSError."""
        (folder / f"{self.name}.svg").write_text(self.svg, encoding="utf-8")
        (folder / f"{self.name}.png").write_bytes(self.png)

    def inline(self) -> Markup:
        """The SVG element without its size, in the colours of the page."""
        opening, _, inside = self.svg[self.svg.index("<svg") :].partition(">")
        box = re.search(r'viewBox="[^"]*"', opening)
        inside = re.sub(r"<metadata>.*?</metadata>", "", inside, count=1, flags=re.DOTALL)
        # The pixels of an image keep their colours, so their legend has to keep them too.
        names = _TEXT_COLOURS if "<image" in inside else _COLOURS
        for colour, name in names.items():
            inside = inside.replace(colour, f"var({name}, {colour})")
        head = (
            f'<svg {box[0] if box else ""} role="img" xmlns:xlink="http://www.w3.org/1999/xlink">'
        )
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
