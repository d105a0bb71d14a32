"""A diagnosis as one HTML file that needs nothing else: no network, no script, light and dark."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from axistwin import __version__
from axistwin.diagnose import figures, signatures, words
from axistwin.diagnose.panels import COLOURS, Panel, svg
from axistwin.diagnose.result import Considered, Diagnosis, Evidence
from axistwin.identify.result import Quantity
from axistwin.output import atomic_write


def write(diagnosis: Diagnosis, path: str | Path) -> None:
    """Writes the report. Raises FileError."""
    with atomic_write(path) as partial:
        partial.write_text(html(diagnosis), encoding="utf-8")


def html(diagnosis: Diagnosis) -> str:
    """The report as a page."""
    name = escape(Path(diagnosis.record.source).name)
    page = _Page()
    sections = [
        *_answer(diagnosis),
        *_simulations(diagnosis, page),
        *_findings(diagnosis, page),
        *_residuals(diagnosis, page),
        *_whiteness(diagnosis, page),
        *_parameters(diagnosis, page),
        *_considered(diagnosis),
        *_record(diagnosis),
    ]
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en">',
            "<head>",
            '<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            '<meta name="color-scheme" content="light dark">',
            f"<title>{name}: what the simulation gets wrong</title>",
            f"<style>{_style_sheet()}</style>",
            "</head>",
            "<body>",
            "<header>",
            "<p class=kicker>What the simulation gets wrong, and why</p>",
            f"<h1>{name}</h1>",
            f"<p class=record>{escape(words.record_line(diagnosis))}</p>",
            "</header>",
            "<main>",
            *sections,
            "</main>",
            f"<footer>axistwin diagnose, version {escape(__version__)}</footer>",
            "</body>",
            "</html>",
            "",
        ]
    )


# ---- The answer


def _answer(diagnosis: Diagnosis) -> list[str]:
    kind = "good" if diagnosis.healthy else "bad"
    return [
        "<section class=answer>",
        f"<p class='verdict {kind}'>{escape(words.verdict(diagnosis))}</p>",
        f"<p class=lead>{escape(words.paragraph(diagnosis))}</p>",
        *_bars(diagnosis),
        *_named(diagnosis),
        *_list("What to do next", [_next(step) for step in words.next_steps(diagnosis)]),
        *_list("What this record cannot tell", [escape(line) for line in diagnosis.advice]),
        "</section>",
    ]


def _list(title: str, lines: Sequence[str]) -> list[str]:
    """A list under a title, both of them only if there is something in it."""
    if not lines:
        return []
    return [
        f"<h2>{title}</h2>",
        "<ul class=next>",
        *(f"<li>{line}</li>" for line in lines),
        "</ul>",
    ]


def _bars(diagnosis: Diagnosis) -> list[str]:
    """The errors as bars from zero."""
    error = diagnosis.error
    largest = max(error.base, error.extended) or 1.0
    bars = [("base model", error.base, "before")]
    if diagnosis.findings:
        bars.append(("extended model", error.extended, "after"))
    bars.append(("noise alone", error.noise_floor, "noise"))
    lines = ["<figure class=bars>", f"<figcaption>{escape(words.title(error.what))}</figcaption>"]
    for label, size, kind in bars:
        text = escape(words.shown(size, error.unit).with_unit)
        width = min(100.0 * size / largest, 100.0)
        lines.append(
            f"<div><span>{label}</span><span class=track><span class='bar {kind}' "
            f"style='width:{width:.2f}%'></span></span><b>{text}</b></div>"
        )
    return [*lines, "</figure>"]


def _named(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.findings:
        return []
    rows = []
    for finding, share in zip(diagnosis.findings, words.explained(diagnosis), strict=True):
        numbers = [
            words.parameter(finding, name, diagnosis.record.linear) for name in finding.params
        ]
        span = f" rowspan={len(numbers)}" if len(numbers) > 1 else ""
        cells = [
            f"<th scope=row{span}>{escape(words.title(words.what(finding.effect)))}</th>",
            f"<td{span}>{escape(words.where(finding.location))}</td>",
        ]
        gain = f"<td class=number{span}>{words.percent(share)}</td>"
        for name, number in zip(finding.params, numbers, strict=True):
            interval = words.joined(number.interval, number.unit) if number.interval else "–"
            cells += [
                f"<td>{escape(name.replace('_', ' '))}</td>",
                f"<td class=number>{escape(number.with_unit)}</td>",
                f"<td class=number>{escape(interval)}</td>",
                gain,
            ]
            rows.append(f"<tr>{''.join(cells)}</tr>")
            cells, gain = [], ""
    head = ("Cause", "Where", "Parameter", "Value", "95 % interval", "Explains")
    return [
        *_table(head, rows),
        "<p class=note>Explains: the share that it takes away of the squared simulation error that "
        "the causes above it leave, on windows that no fit has seen.</p>",
    ]


def _next(step: str) -> str:
    """A line with its verb set off."""
    verb, colon, rest = step.partition(":")
    if not colon or len(verb) > len("Re-time the channel"):
        return escape(step)
    return f"<b>{escape(verb)}:</b>{escape(rest)}"


# ---- The evidence


class _Page:
    """Numbers the figures of a page: what is named in one must not be in another."""

    def __init__(self) -> None:
        self._count = 0

    def figures(self, panels: Iterable[Panel], kind: str = "panels") -> list[str]:
        """Panels side by side where there is room; more of them of the ``kind`` "small panels"."""
        return [f"<div class='{kind}'>", *(self._figure(panel) for panel in panels), "</div>"]

    def _figure(self, panel: Panel) -> str:
        self._count += 1
        label = escape(panel.figure.axes[0].get_title(loc="left"))
        caption = f"<figcaption>{escape(panel.caption)}</figcaption>" if panel.caption else ""
        drawn = svg(panel.figure, f"f{self._count}", label)
        kind = " class=wide" if panel.wide else ""
        return f"<figure{kind}><div class=scroll>{drawn}</div>{caption}</figure>"


def _section(title: str, text: str, lines: Iterable[str]) -> list[str]:
    return [
        "<section>",
        f"<h2>{escape(title)}</h2>",
        *([f"<p>{escape(text)}</p>"] if text else []),
        *lines,
        "</section>",
    ]


def _simulations(diagnosis: Diagnosis, page: _Page) -> list[str]:
    return _section(
        "Measured against simulated",
        f"The record is cut into windows of {diagnosis.window:.3g} s, in each of which the axis is "
        "simulated anew from its torque alone, beginning in the state that suits the model best. "
        "Every third window is kept from all fits.",
        page.figures(figures.simulations(diagnosis)),
    )


def _findings(diagnosis: Diagnosis, page: _Page) -> list[str]:
    lines = []
    acting = diagnosis.findings[: len(diagnosis.evidence.contributions)]
    for index, finding in enumerate(acting):
        title = words.title(words.cause(finding.effect, finding.location))
        lines += _section(
            f"Cause {index + 1}: {title[:1].lower()}{title[1:]}",
            "",
            page.figures(signatures.panels(diagnosis, index)),
        )
    return lines


def _residuals(diagnosis: Diagnosis, page: _Page) -> list[str]:
    lines = []
    text = (
        "What the axis would have needed beyond what was applied, to move as it was measured "
        "(Eq. 18), against everything that an effect could depend on. A shape in the grey cloud is "
        "an effect"
    )
    if diagnosis.findings:
        text += "; a shape in the blue one would be an effect that was missed"
        lines.append(
            "<p class=key><span class=cloud></span> without any effect "
            "<span class='cloud after'></span> with all that were named</p>"
        )
    for place in _places(diagnosis.evidence):
        lines.append(f"<h3>{escape(words.title(signatures.RESIDUAL[place]))}</h3>")
        lines += page.figures(figures.residuals(diagnosis, place), "small panels")
    return _section(
        "Residual torque, before and after" if diagnosis.findings else "Residual torque",
        f"{text}.",
        lines,
    )


def _places(evidence: Evidence) -> list[str]:
    """Where torque may be lacking, then the encoders that something was found at."""
    found = {one.place for one in evidence.contributions}
    torques = [place for place in ("motor", "table") if place in evidence.residuals]
    encoders = [place for place in ("encoder1", "encoder2") if place in found]
    return [*torques, *encoders]


def _whiteness(diagnosis: Diagnosis, page: _Page) -> list[str]:
    return _section(
        "Is what is left noise?",
        "Noise is like nothing that came before it. The error of a model that misses something "
        "goes on from sample to sample.",
        page.figures(figures.whiteness(diagnosis)),
    )


def _parameters(diagnosis: Diagnosis, page: _Page) -> list[str]:
    models = {"Base model": diagnosis.base, "Extended model": diagnosis.axis}
    if not diagnosis.findings:
        models = {"Base model": diagnosis.axis}
    head = [cell for model in models for cell in (model, "95 % interval")]
    rows = [
        f"<tr><th scope=row>{escape(name)}</th>"
        f"{''.join(_number(model[name]) for model in models.values())}</tr>"
        for name in diagnosis.axis
    ]
    lines = _table(["", *head], rows)
    if not diagnosis.base_valid:
        lines.append("<p class=note>This record does not determine all of them.</p>")
    if diagnosis.evidence.tracks:
        lines += page.figures(figures.tracks(diagnosis))
    return _section(
        "Parameters of the axis",
        "A model that lacks something bends its parameters to make up for it. With the right "
        "causes in it they are the same along the whole record.",
        lines,
    )


def _number(item: Quantity) -> str:
    number = words.quantity(item)
    interval = words.joined(number.interval, number.unit)
    return (
        f"<td class=number>{escape(number.with_unit)}</td><td class=number>{escape(interval)}</td>"
    )


def _considered(diagnosis: Diagnosis) -> list[str]:
    ordered = sorted(diagnosis.considered, key=_interest, reverse=True)
    rows = [
        f"<tr><th scope=row>{escape(words.title(words.what(one.effect)))}</th>"
        f"<td>{escape(words.where(one.location))}</td>"
        f"<td class=number>{words.percent(words.would_explain(diagnosis, one))}</td>"
        f"<td>{escape(words.reason(one.verdict))}</td></tr>"
        for one in ordered
    ]
    return _section(
        "What else was considered",
        "Each effect of the catalogue was added to the final model in turn and fitted. It would "
        "have been named had it made windows that no fit has seen better beyond chance.",
        _table(("Effect", "Where", "Would explain of what is left", "Named?"), rows),
    )


def _interest(one: Considered) -> tuple[bool, float]:
    """What is not a plain no comes first, then by gain."""
    return one.verdict != "no", one.gain


def _record(diagnosis: Diagnosis) -> list[str]:
    record = diagnosis.record
    facts = {
        "File": record.source,
        "Samples": words.record_line(diagnosis),
        "Channels": ", ".join(record.channels),
        "Torque between samples": {
            "zoh": "held from each to the next",
            "foh": "linear from each to the next",
            "newmark": "by the trapezoidal rule of the emulated axis",
        }[diagnosis.hold],
    }
    lines = [
        "<dl>",
        *(f"<dt>{key}</dt><dd>{escape(value)}</dd>" for key, value in facts.items()),
        "</dl>",
    ]
    warnings = list(dict.fromkeys((*record.warnings, *diagnosis.warnings)))
    if warnings:
        lines += ["<h3>To be known about it</h3>", "<ul>"]
        lines += [f"<li>{escape(warning)}</li>" for warning in warnings]
        lines.append("</ul>")
    return _section("The record", "", lines)


def _table(head: Sequence[str], rows: Iterable[str]) -> list[str]:
    cells = "".join(f"<th scope=col>{escape(cell)}</th>" for cell in head)
    return [
        "<div class=scroll><table>",
        f"<thead><tr>{cells}</tr></thead>",
        "<tbody>",
        *rows,
        "</tbody></table></div>",
    ]


# ---- How it looks

_DARK = {
    "ink": "#dfe5ea",
    "grid": "#323b44",
    "measured": "#6f7c88",
    "before": "#f08a3c",
    "after": "#56b4e9",
    "curve": "#ff7ac3",
    "band": "#2a333c",
}


def _style_sheet() -> str:
    light, dark = (
        "".join(f"--{name}:{colour};" for name, colour in colours.items())
        for colours in (COLOURS, _DARK)
    )
    return (
        f":root{{{light}{_LIGHT_PAGE}}}\n"
        f"@media screen and (prefers-color-scheme:dark){{:root{{{dark}{_DARK_PAGE}}}}}\n{_SHEET}"
    )


_LIGHT_PAGE = "--page:#ffffff;--card:#f5f7f9;--soft:#5c6873;--good:#00785a;--bad:#b84500;"
_DARK_PAGE = "--page:#14181c;--card:#1c2228;--soft:#98a4af;--good:#3cc79d;--bad:#f5914d;"
_SHEET = """
*{box-sizing:border-box}
body{margin:0 auto;padding:2rem 1.25rem 3rem;max-width:68rem;background:var(--page);
color:var(--ink);font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"DejaVu Sans",sans-serif}
h1{margin:.1rem 0;font-size:1.7rem;overflow-wrap:anywhere}
h2{margin:0 0 .4rem;font-size:1.2rem}
h3{margin:1.4rem 0 .2rem;font-size:1rem}
section{margin:2.6rem 0}
section>p{max-width:46rem;margin:.2rem 0 1rem}
.kicker,.record,footer,.note,figcaption,.key{color:var(--soft)}
.kicker{margin:0;font-size:.85rem;letter-spacing:.04em}
.record{margin:0}
.answer{margin-top:1.4rem;padding:1.4rem;border-radius:.7rem;background:var(--card)}
.answer h2{margin-top:1.6rem}
.answer>p.lead{font-size:1.1rem;max-width:54rem}
.answer>p.verdict{margin:0;font-weight:700;font-size:1.25rem}
.good{color:var(--good)}.bad{color:var(--bad)}
.bars{margin:1.2rem 0;max-width:54rem}
.bars div{display:grid;grid-template-columns:8.5rem 1fr 6.5rem;gap:.8rem;align-items:center}
.bars b{font-variant-numeric:tabular-nums;font-weight:600}
.track{height:.85rem}
.bar{display:block;height:100%;min-width:2px;border-radius:.2rem;background:var(--measured);
print-color-adjust:exact;-webkit-print-color-adjust:exact}
.bar.before{background:var(--before)}.bar.after{background:var(--after)}
.next{padding-left:1.2rem;max-width:54rem}.next li{margin:.35rem 0}
table{border-collapse:collapse;width:100%;font-size:.95rem}
table+.panels,.scroll+.panels{margin-top:1.4rem}
th,td{padding:.35rem .9rem .35rem 0;text-align:left;vertical-align:top;
border-bottom:1px solid var(--grid)}
thead th{font-weight:500;color:var(--soft);font-size:.85rem;vertical-align:bottom}
tbody th{font-weight:600}
.number{white-space:nowrap;font-variant-numeric:tabular-nums}
.note,figcaption,.key,footer{font-size:.85rem}
.scroll{overflow-x:auto}
.panels{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(26rem,100%),1fr));
gap:1.6rem 1.4rem}
.small.panels{grid-template-columns:repeat(auto-fill,minmax(min(18rem,100%),1fr))}
figure{margin:0;break-inside:avoid;min-width:0}
figcaption{margin-top:.2rem}
figure svg{display:block;width:100%;height:auto}
figure svg text{font-family:inherit}
.wide{grid-column:1/-1}
.wide svg{min-width:42rem}
.cloud{display:inline-block;width:.7rem;height:.7rem;border-radius:50%;background:#8894a0;
margin-left:.8rem;print-color-adjust:exact;-webkit-print-color-adjust:exact}
.cloud:first-child{margin-left:0}
.cloud.after{background:#3d8fc6}
dl{display:grid;grid-template-columns:max-content 1fr;gap:.2rem 1.2rem;margin:0}
dt{color:var(--soft)}dd{margin:0;overflow-wrap:anywhere}
@media(max-width:38rem){
body{padding:1rem .8rem 2rem}.answer{padding:1rem}
.bars div{grid-template-columns:1fr 6.5rem;gap:0 .6rem}.track{grid-column:1/-1;grid-row:2}
dl{grid-template-columns:1fr}dd{margin-bottom:.4rem}}
@media print{body{padding:0;max-width:none;font-size:10pt}section{margin:1.4rem 0}
.answer{border:1px solid var(--grid)}.panels{grid-template-columns:1fr 1fr}
h2,h3{break-after:avoid}tr{break-inside:avoid}}
"""
