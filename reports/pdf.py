"""A page as PDF, by WeasyPrint, which the extra `[pdf]` brings; nothing else needs it.

It runs no script and knows little of grids, so that what stands side by side on the page is set in
lines here.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Protocol, cast

STYLE = """
@page { size: A4; margin: 16mm; }
main, section.record, header { display: block; break-before: auto; break-inside: auto; }
.tiles, .charts, .gallery { display: block; }
.tiles > li { display: inline-block; width: 30%; margin-right: 2%; vertical-align: top; }
.gallery figure { display: inline-block; width: 30%; margin-right: 2%; vertical-align: top; }
.gallery figure.wide { width: 62%; }
.charts figure.chart { display: block; overflow: visible; margin: 0 0 12pt; }
.chart svg, .chart.wide svg { width: 178mm; max-width: none; min-width: 0; }
.chart.narrow svg { width: 120mm; }
.families, .readout { display: none; }
"""


class PdfMissingError(RuntimeError):
    """WeasyPrint cannot be used here; the message is one line with a remedy."""


class _Document(Protocol):
    def write_pdf(self, target: str) -> None:
        """Write the file."""


class _WeasyPrint(Protocol):
    """What is used of the module weasyprint."""

    def HTML(self, *, string: str) -> _Document:  # noqa: N802 - WeasyPrint's own name
        """Read a page."""


def write_pdf(page: Path, output: Path | None = None) -> Path:
    """Write a page of `vctgi report` or `vctgi study` as PDF; return its path.

    Parameters
    ----------
    page
        The HTML file.
    output
        The PDF; left out: beside the page, with its name.

    Raises
    ------
    PdfMissingError
        WeasyPrint, or the library Pango that it needs, is not installed.
    ValueError
        There is no such page.
    """
    if not page.is_file():
        raise ValueError(f"{page}: no such page; make it with `vctgi study NAME --output`")
    weasyprint = _weasyprint()
    target = output or page.with_suffix(".pdf")
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_name(f".{target.name}.partial")
    # The page's own style comes first, so that what is said here stands.
    text = page.read_text(encoding="utf-8").replace("</head>", f"<style>{STYLE}</style></head>", 1)
    weasyprint.HTML(string=text).write_pdf(str(partial))
    partial.replace(target)
    return target


def require_pdf() -> None:
    """Find out before any work whether a PDF can be written.

    Raises
    ------
    PdfMissingError
        It cannot.
    """
    _weasyprint()


def _weasyprint() -> _WeasyPrint:
    """Import WeasyPrint."""
    try:
        return cast(_WeasyPrint, importlib.import_module("weasyprint"))
    except (ImportError, OSError) as error:
        raise PdfMissingError(
            f"a PDF needs WeasyPrint, which cannot be loaded ({error}): install the extra, "
            "pip install 'vctgi[pdf]', and the library Pango (Debian: libpangoft2-1.0-0)."
        ) from error
