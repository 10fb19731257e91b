"""`--keep` on the command line: what a scene does not need, kept all the same."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from experiments.cli import main
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE


def test_what_a_scene_does_not_need_can_be_kept(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = tmp_path / "plan.json"
    arguments = ["plan", "cornell_box", "--resolution", "16", "--json", str(entries)]
    assert main([*arguments, "--keep", "specular,alpha", "--keep", "levels"]) == EXIT_DONE
    by_item = {e["item"]: e for e in json.loads(entries.read_text(encoding="utf-8"))}
    assert by_item["specular cones"]["kept"]
    assert "asked for by keep specular" in by_item["specular cones"]["reason"]
    assert by_item["texture coordinates for voxelization"]["override"] == "--keep textures"
    assert "picture: bit for bit; override: --keep textures" in capsys.readouterr().out


def test_keeping_what_does_not_exist_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for command in (
        ["plan", "cornell_box"],
        ["render", "cornell_box", "-o", "x.exr"],
        ["report", "cornell_box"],
    ):
        assert main([*command, "--keep", "speculr"]) == EXIT_BAD_INPUT
        error = capsys.readouterr().err
        assert "nothing is called 'speculr'" in error
        assert "use all, specular" in error


def test_a_record_names_what_is_kept_and_nothing_where_nothing_is(variant: str) -> None:
    """An option that overrides nothing leaves the configuration that gates compare as it was."""
    import vctgi
    from experiments.record import config_values

    config = vctgi.preset("medium")
    assert "keep" not in config_values(config)
    assert config_values(replace(config, keep=("sky",)))["keep"] == ("sky",)
