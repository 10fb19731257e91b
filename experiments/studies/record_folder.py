"""The folder of `--output`: the records of studies, their pictures, one page and one summary."""

from __future__ import annotations

import re
from pathlib import Path

from experiments.scenes import scene_file_name
from reports.image_files import unused_name_beside
from reports.study_figures import Figure, MapFigure, PictureFigure
from reports.study_markdown import write_summary
from reports.study_page import study_files, write_study_page
from reports.study_record import StudyRecord, read_study, record_text


class RecordFolder:
    """Where one study leaves what it found.

    Parameters
    ----------
    folder
        Made already.
    study
        Name of the study.
    scene
        The scene that the user asked for: the same study of another scene is another record.
    """

    def __init__(self, folder: Path, study: str, scene: str | None) -> None:
        self._folder = folder
        name = "" if scene is None else scene_file_name(Path(scene))
        place = re.sub(r"[^A-Za-z0-9_]+", "-", name).strip("-")
        self._stem = f"{study}-{place}" if place else study

    @property
    def record(self) -> Path:
        """File of the record."""
        return self._folder / f"{self._stem}.json"

    @property
    def pictures(self) -> Path:
        """Folder of its maps and pictures."""
        return self._folder / self._stem

    def earlier_figures(self, command: str, code: str) -> list[Figure]:
        """Return the figures of an earlier run of one command by the same code.

        What a resumed run does not measure again it does not draw again.
        """
        if not self.record.is_file():
            return []
        earlier = read_study(self.record)
        if (earlier.command, earlier.code) != (command, code):
            return []
        return [figure for figure in earlier.figures if self._is_whole(figure)]

    def _is_whole(self, figure: Figure) -> bool:
        if isinstance(figure, MapFigure | PictureFigure):
            return (self._folder / figure.file.path).is_file()
        return True

    def write(self, record: StudyRecord) -> None:
        """Write the record, whole or not at all."""
        temporary = unused_name_beside(self.record)
        temporary.write_text(record_text(record), encoding="utf-8")
        temporary.replace(self.record)

    def write_page(self) -> Path:
        """Write the page and the Markdown summary of all studies in the folder; return the page."""
        write_summary(study_files(self._folder), self._folder)
        return write_study_page(self._folder)
