"""`python -m reports.publish`: records -> a small snapshot of pages, pictures and tables for git.

It renders nothing: the records are those of `vctgi report` and `vctgi study NAME --output`.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from reports.accuracy import accuracy_report
from reports.markdown import markdown_summary
from reports.sheet import write_sheet
from reports.study_markdown import SUMMARY_NAME, study_summary, summary_charts
from reports.study_page import PAGE_NAME, study_files, study_page

ACCURACY_NAME, SHEET_NAME = "accuracy.html", "sheet.jpg"

MOST_BYTES = 4 * 2**20
"""Of the whole snapshot: it stays in the history of the repository for ever."""

SHEET_WIDTH = 120
"""Of each picture, pixels."""


def publish(report: Path, studies: Path, output: Path) -> list[Path]:
    """Write the snapshot in place of the one before it.

    Parameters
    ----------
    report
        Folder of `vctgi report`, with `records/`.
    studies
        Folder of `vctgi study NAME --output`.
    output
        Gets the pages of accuracy and of studies, which lead to one another, a summary in Markdown,
        a sheet of pictures and a chart of each scene's methods.

    Returns
    -------
    list
        The files.

    Raises
    ------
    ValueError
        Records are missing or broken, or the snapshot is too large; nothing is changed then.
    """
    records = sorted((report / "records").glob("*.json"))
    found = study_files(studies)
    pages = {
        PAGE_NAME: study_page(found, accuracy_page=ACCURACY_NAME),
        ACCURACY_NAME: accuracy_report(records, studies_page=PAGE_NAME),
        SUMMARY_NAME: (
            "# Accuracy, and studies\n\n"
            f"Pages: [studies]({PAGE_NAME}), [accuracy]({ACCURACY_NAME}). "
            "Made by `make publish`.\n\n"
            f"## Accuracy\n\n{markdown_summary(records)}\n## Studies\n\n{study_summary(found)}"
        ),
    }
    pages |= summary_charts(found)
    size = sum(len(text.encode()) for text in pages.values())
    if size > MOST_BYTES:
        raise ValueError(
            f"publish: the pages take {size / 2**20:.1f} MiB of {MOST_BYTES / 2**20:.0f}: make the "
            "records with fewer presets, or smaller pictures (`--resolution`)."
        )
    if output.exists():
        shutil.rmtree(output)
    output.mkdir(parents=True)
    for name, text in pages.items():
        (output / name).write_text(text, encoding="utf-8")
    write_sheet(records, output / SHEET_NAME, width=SHEET_WIDTH)
    return sorted(output.iterdir())


def main(arguments: Sequence[str] | None = None) -> int:
    """Publish what the command line names; 2 where that cannot be."""
    parser = argparse.ArgumentParser(prog="python -m reports.publish", description=__doc__)
    parser.add_argument("--report", type=Path, required=True, help="folder of vctgi report")
    parser.add_argument("--studies", type=Path, required=True, help="folder of vctgi study")
    parser.add_argument("--output", type=Path, required=True, help="folder that is replaced")
    given = parser.parse_args(arguments)
    try:
        written = publish(given.report, given.studies, given.output)
    except ValueError as error:
        sys.stderr.write(f"publish: {error}\n")
        return 2
    sys.stdout.writelines(f"{path} {path.stat().st_size / 1024:.0f} KiB\n" for path in written)
    return 0


if __name__ == "__main__":
    sys.exit(main())
