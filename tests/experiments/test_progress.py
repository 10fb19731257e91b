"""What long work says of itself where there is no terminal."""

from __future__ import annotations

import pytest

from experiments.progress import ProgressReport, time_text


def test_a_step_says_its_share_and_the_time_left(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = 100.0
    monkeypatch.setattr("experiments.progress.time.monotonic", lambda: now)
    with ProgressReport() as progress:
        progress.start_scene("a room", 1, 1)
        # A fifth was on disk; what follows takes 60 s a fifth
        progress("path tracing", 0.2)
        now = 160.0
        progress("path tracing", 0.4)
        now = 161.0
        progress("path tracing", 0.41)
        now = 280.0
        progress("path tracing", 1.0)
    assert capsys.readouterr().err.splitlines() == [
        "[1/1] a room: path tracing",
        "[1/1] a room: path tracing 40 %, about 3 min left",
        "[1/1] a room: path tracing 100 %",
    ]


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (89.0, "89 s"), (100.0, "2 min"), (7500.0, "2 h 05 min")]
)
def test_durations_read_as_people_say_them(seconds: float, text: str) -> None:
    assert time_text(seconds) == text


def test_names_between_colons_stay_words(capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressReport() as progress:
        progress.say("peer:ogre: half the light")
    assert "peer:ogre: half the light" in capsys.readouterr().err
