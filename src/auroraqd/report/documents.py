"""A document as data, a list of headings, sentences, tables and pictures, written as Markdown, as a page, or as PDF.

The page is one file that fetches nothing. The PDF is drawn by Matplotlib.
"""

import base64
import html
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from auroraqd._files import replacing
from auroraqd.report.style import STYLE, png_of

_DPI = 110
_NO_DATE = {"CreationDate": None}  # or the same report would give another file each time
_CSS = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1250px; margin: 2em auto; padding: 0 1.5em }
h1, h2, h3 { line-height: 1.25 } h2 { margin-top: 2.2em; border-bottom: 1px solid #ccc } h3 { margin-top: 1.8em }
table { border-collapse: collapse; margin: 1em 0; font-size: 13px; line-height: 1.4 } .wide { overflow-x: auto }
th, td { border-bottom: 1px solid #ddd; padding: .35em .7em; text-align: left; vertical-align: top }
th { border-bottom: 2px solid #999 } img { max-width: 100% } figure { margin: 1.5em 0 } figcaption { color: #555 }
.agrees, .differs, .unknown { font-weight: 600; white-space: nowrap }
.agrees { color: #11693f } .differs { color: #a8321a } .unknown { color: #666 }
"""
_MARKS = {"agrees": "agrees", "differs": "differs", "cannot be known": "unknown"}
_COLORS = {"agrees": "#11693f", "differs": "#a8321a", "unknown": "#666666"}


class Heading(NamedTuple):
    """A title, of level 1, or one below it."""

    text: str
    level: int = 2


class Text(NamedTuple):
    """A paragraph."""

    text: str


class Table(NamedTuple):
    """Cells of text, with the share of the width of each column where they are long."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    widths: Sequence[float] = ()


class Picture(NamedTuple):
    """A figure and what it shows."""

    figure: Figure
    caption: str


Document = Sequence[Heading | Text | Table | Picture]


def markdown(document: Document) -> str:
    """As Markdown, without pictures."""
    parts = []
    for block in document:
        match block:
            case Heading(text, level):
                parts.append(f"{'#' * level} {text}")
            case Text(text):
                parts.append("\n".join(textwrap.wrap(text, 140, break_on_hyphens=False)))
            case Table(header, rows):
                lines = [header, ["---"] * len(header), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
                parts.append("\n".join(f"| {' | '.join(line)} |" for line in lines))
    return "\n\n".join(parts) + "\n"


def page(document: Document) -> str:
    """As a page in HTML that holds all that it shows."""
    title = next((block.text for block in document if isinstance(block, Heading)), "")
    body = "\n".join(map(_html, document))
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{html.escape(title)}</title>'
    return f'<!doctype html>\n<html lang="en"><head>{head}<style>{_CSS}</style></head><body>\n{body}\n</body></html>\n'


def _html(block: Heading | Text | Table | Picture) -> str:
    match block:
        case Heading(text, level):
            return f"<h{level}>{html.escape(text)}</h{level}>"
        case Text(text):
            return f"<p>{html.escape(text)}</p>"
        case Table(header, rows):
            head = "".join(f"<th>{html.escape(cell)}</th>" for cell in header)
            body = "\n".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows)
            return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table></div>'
        case Picture(figure, caption):
            image = base64.b64encode(png_of(figure, _DPI)).decode()
            said = html.escape(caption)
            return f'<figure><img alt="{said}" src="data:image/png;base64,{image}"><figcaption>{said}</figcaption></figure>'


def _cell(text: str) -> str:
    mark = _MARKS.get(text)
    return f'<td class="{mark}">{text}</td>' if mark else f"<td>{html.escape(text)}</td>"


def write_pdf(document: Document, path: Path) -> None:
    """As PDF: text and tables on pages of A4, across; a picture on a page of its own."""
    with mpl.rc_context({**STYLE, "pdf.fonttype": 42}), replacing(path) as file, PdfPages(file, metadata=_NO_DATE) as pdf:
        sheets = _Sheets(pdf)
        for block in document:
            match block:
                case Heading(text, level):
                    sheets.line(text, {1: 18, 2: 14}.get(level, 11), before=0.25, weight="bold", keep=1.2)
                case Text(text):
                    for line in textwrap.wrap(text, 165):
                        sheets.line(line, 9)
                case Table():
                    sheets.table(block)
                case Picture(figure, caption):
                    sheets.finish()
                    figure.text(0.5, 1.01, caption, ha="center", va="bottom", fontsize=9, color="#444444")
                    pdf.savefig(figure, bbox_inches="tight", pad_inches=0.3, dpi=150)
        sheets.finish()


class _Sheets:
    """Pages that fill up with lines and tables from above."""

    _width, _height, _margin = 11.69, 8.27, 0.6  # inches

    def __init__(self, pdf: PdfPages):
        self._pdf = pdf
        self._figure: Figure | None = None
        self._y = 0.0

    def finish(self) -> None:
        """End the page that was begun."""
        if self._figure is not None:
            self._pdf.savefig(self._figure)
            self._figure = None

    def line(self, text: str, size: float, *, before: float = 0.05, weight: str = "normal", keep: float = 0.0) -> None:
        """A line of text, on the same page as `keep` inches of what follows."""
        height = size * 1.4 / 72
        self._room(before + height + keep)
        self._y -= before + height
        self._put(self._margin, text, size, weight=weight)

    def table(self, table: Table) -> None:
        """A table whose cells are wrapped, its header again on each page."""
        size = 7.0 if len(table.header) < 9 else 5.6
        inside = self._width - 2 * self._margin
        widths = [inside * share for share in table.widths] or self._even(table, inside)
        columns = [max(4, int((width - 0.08) * 72 / (size * 0.57))) for width in widths]

        def wrapped(row: Sequence[str]) -> list[list[str]]:
            return [textwrap.wrap(cell, most) or [""] for cell, most in zip(row, columns, strict=True)]

        header = wrapped(table.header)
        self._y -= 0.08
        self._row(header, widths, size, header)
        for row in table.rows:
            self._row(wrapped(row), widths, size, header)
        self._y -= 0.1

    def _even(self, table: Table, inside: float) -> list[float]:
        """Widths by the longest cell of each column."""
        longest = [max(len(row[i]) for row in (table.header, *table.rows)) + 2 for i in range(len(table.header))]
        return [min(inside * share / sum(longest), 0.08 + 0.075 * share) for share in longest]

    def _row(self, cells: list[list[str]], widths: list[float], size: float, header: list[list[str]]) -> None:
        height = max(map(len, cells)) * size * 1.25 / 72 + 0.06
        if self._room(height) and cells is not header:
            self._row(header, widths, size, header)
        x, top = self._margin, self._y
        for lines, width in zip(cells, widths, strict=True):
            mark = _MARKS.get(" ".join(lines), "")
            bold = "bold" if cells is header or mark else "normal"
            for i, text in enumerate(lines):
                self._y = top - (i + 1) * size * 1.25 / 72
                self._put(x, text, size, weight=bold, color=_COLORS.get(mark, "black"))
            x += width
        self._y = top - height
        assert self._figure is not None
        rule = [self._margin / self._width, (x - 0.05) / self._width], [(self._y + 0.01) / self._height] * 2
        self._figure.add_artist(Line2D(*rule, color="#bbbbbb", linewidth=0.9 if cells is header else 0.4))

    def _put(self, x: float, text: str, size: float, *, weight: str, color: str = "black") -> None:
        assert self._figure is not None
        place = x / self._width, self._y / self._height
        self._figure.text(*place, text, fontsize=size, weight=weight, color=color, va="baseline", parse_math=False)

    def _room(self, height: float) -> bool:
        """Whether a new page had to be begun for this much."""
        if self._figure is not None and self._y - height > self._margin:
            return False
        self.finish()
        self._figure, self._y = Figure(figsize=(self._width, self._height)), self._height - self._margin
        return True
