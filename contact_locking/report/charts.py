"""Charts as files and as part of the page, where they follow its colours."""

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

from contact_locking.plotting import style

# About as wide as a phone, so that the text stays readable there.
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
# Colours of the charts that the page has its own for, light and dark.
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
    """A chart with the name of its files and, for those who do not see it, what it shows."""

    name: str
    description: str
    svg: str
    png: bytes

    def write(self, folder: Path) -> None:
        """``NAME.svg`` and ``NAME.png``. Raises OSError."""
        (folder / f"{self.name}.svg").write_text(self.svg, encoding="utf-8")
        (folder / f"{self.name}.png").write_bytes(self.png)

    def inline(self) -> Markup:
        """The SVG element alone, coloured by the page and of any size."""
        opening, _, inside = self.svg[self.svg.index("<svg") :].partition(">")
        box = re.search(r'viewBox="[^"]*"', opening)
        inside = re.sub(r"<metadata>.*?</metadata>", "", inside, count=1, flags=re.DOTALL)
        # Pixels keep their colours, and with them the legend of what they mean.
        names = _TEXT_COLOURS if "<image" in inside else _COLOURS
        for colour, name in names.items():
            inside = inside.replace(colour, f"var({name}, {colour})")
        head = (
            f'<svg {box[0] if box else ""} role="img" xmlns:xlink="http://www.w3.org/1999/xlink">'
        )
        label = Markup("<title>{}</title>").format(self.description)
        return Markup(head) + label + Markup(inside)


def chart(name: str, description: str, height: float, draw: Callable[[Figure], None]) -> Chart:
    """Let ``draw`` fill a figure of the width of all charts, and render it."""
    # The salt makes the identifiers inside a chart its own: several are on one page.
    with matplotlib.rc_context(_RC | {"svg.hashsalt": name}):
        drawing = Figure(figsize=(WIDTH, height))
        draw(drawing)
        svg, png = _rendered(drawing)
    return Chart(name, description, svg, png)


def _rendered(drawing: Figure) -> tuple[str, bytes]:
    svg, png = io.StringIO(), io.BytesIO()
    FigureCanvasSVG(drawing).print_svg(svg, metadata={"Date": None, "Creator": None})
    FigureCanvasAgg(drawing)
    drawing.savefig(png, format="png", dpi=style.DPI, facecolor="white")
    return svg.getvalue(), png.getvalue()
