"""The page of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from contact_locking.results.read import RunResults
from contact_locking.solution import STATE_NAMES, ContactPoints

from .certificate import certificate
from .charts import Chart, figure
from .contact_charts import contact_charts
from .markup import Content, Markup, element, named, section, shown, table
from .page import DESCRIPTION, page
from .pictures import picture
from .quantities import LOAD_UNIT_NOTE, QUANTITIES


def run_page(run: RunResults) -> tuple[str, list[Chart]]:
    """The HTML document of a run and its charts."""
    summary = run.summary
    charts = contact_charts(run)
    html = page(
        shown(summary.get("title") or "Run"),
        _verdict(summary),
        _warnings(summary.get("warnings")),
        element("div", _picture(run), _numbers(summary), class_="columns"),
        _on_contact(run.contact, charts),
        certificate(summary),
        _iterations(summary),
        section("Parameters", parameters(run.parameters, opened=True)),
        _footer(summary),
    )
    return html, [chart for _, drawn in charts for chart in drawn]


def parameters(text: str, opened: bool) -> Markup:
    """The saved study file, with every default written out."""
    title = element("summary", "The study file with every default")
    return element("details", title, element("pre", element("code", text)), open=opened)


def _verdict(summary: Mapping[str, Any]) -> Markup:
    if summary["converged"]:
        reason = str(summary.get("reason") or "")
        return element("div", element("strong", "Converged"), reason, class_="verdict")
    reason = shown(summary.get("reason") or "no reason is given")
    title = "Infeasible on this mesh" if reason.startswith("infeasible") else "Not converged"
    way_out = summary.get("suggestion")
    return element(
        "div",
        element("strong", title),
        element("p", reason.removeprefix("infeasible: ")),
        element("p", shown(way_out)) if way_out else None,
        element("p", "What follows is what was reached. It is not a solution."),
        class_="verdict bad",
    )


def _warnings(warnings: Any) -> list[Markup]:
    listed = warnings if isinstance(warnings, list) else []
    return [element("p", f"Warning: {shown(text)}", class_="warning") for text in listed]


def _picture(run: RunResults) -> Markup:
    if run.picture is None:
        text = "None was drawn; output.picture is false, or the log has the reason."
        return section("Picture", element("p", text, class_="soft"))
    source = picture(run.picture)
    if source is None:
        text = f"{run.picture.name} cannot be read as a picture."
        return section("Picture", element("p", text, class_="soft"))
    description = "The deformed body on its foundation, coloured by strain"
    return section("Picture", element("figure", element("img", src=source, alt=description)))


def _on_contact(contact: ContactPoints, charts: Sequence[tuple[str, list[Chart]]]) -> Markup:
    if not charts:
        return section("Contact", element("p", "The body has no contact boundary.", class_="soft"))
    counts = np.bincount(contact.state, minlength=len(STATE_NAMES))
    listed = ", ".join(f"{n} {name}" for n, name in zip(counts, STATE_NAMES, strict=True) if n)
    grid = "charts wide" if contact.dim == 2 else "charts"
    below = "; the maps show it from the foundation's side" if contact.dim == 3 else ""
    return section(
        "Along the contact boundary" if contact.dim == 2 else "On the contact boundary",
        element("p", f"{len(contact.x)} points: {listed}{below}.", class_="soft"),
        [
            [
                element("h3", name) if name else None,
                element("div", [figure([chart]) for chart in drawn], class_=grid),
            ]
            for name, drawn in charts
        ],
    )


def _numbers(summary: Mapping[str, Any]) -> Markup:
    rows: list[list[Content]] = []
    for quantity in QUANTITIES:
        if (found := _look_up(summary, quantity.key)) is not None:
            number = element("span", shown(found), class_="number")
            unit = None if quantity.unit == "1" else element("span", quantity.unit, class_="soft")
            rows.append([named(quantity.key, quantity.meaning), [number, " ", unit]])
    return section(
        "Key numbers",
        table(("", "value"), rows) if rows else None,
        element("p", LOAD_UNIT_NOTE, class_="soft"),
    )


def _iterations(summary: Mapping[str, Any]) -> Markup:
    totals = summary.get("iterations")
    content: list[Content] = []
    if isinstance(totals, dict):
        words = ", ".join(f"{shown(number)} {name}" for name, number in totals.items())
        content.append(element("p", f"In the whole solve: {words}."))
    if summary.get("restart"):
        content.append(element("p", f"Restart: {shown(summary['restart'])}."))
    stages = summary.get("stages")
    known = (
        [stage for stage in stages if isinstance(stage, dict)] if isinstance(stages, list) else []
    )
    if known:
        names = list(dict.fromkeys(str(name) for stage in known for name in stage))
        rows = [
            [str(number), *(shown(stage.get(name)) for name in names)]
            for number, stage in enumerate(known, start=1)
        ]
        content.append(table(("stage", *names), rows))
    return section("Iterations", content)


def _footer(summary: Mapping[str, Any]) -> Markup:
    told = (
        f"contact_locking {shown(summary.get('version'))}",
        f"DOLFINx {shown(summary.get('dolfinx'))}",
        f"{shown(summary.get('ranks'))} rank(s)",
        f"parameters {shown(summary.get('fingerprint'))}",
    )
    return element("footer", f"{DESCRIPTION}: {', '.join(told)}")


def _look_up(summary: Mapping[str, Any], dotted: str) -> Any:
    value: Any = summary
    for name in dotted.split("."):
        value = value.get(name) if isinstance(value, dict) else None
    return value
