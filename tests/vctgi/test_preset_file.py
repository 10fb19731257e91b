"""Preset files: what is written is read, and what is wrong is one line."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import mitsuba as mi
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vctgi import config as config_module
from vctgi.config import PRESETS, RenderConfig, preset, preset_names
from vctgi.errors import PresetFileError
from vctgi.preset_file import PresetFile, config_changes, read_preset_file, write_preset_file

HIGH = PRESETS["high"]


def fitted(scale: float = 1.25) -> RenderConfig:
    """Return a configuration that differs from "high" in every kind of field."""
    diffuse = replace(
        HIGH.diffuse,
        aperture_scale=scale,
        rotation="frame",
        is_jittered=False,
        cone_weights=tuple(1.0 + k / 7.0 for k in range(17)),
        march=replace(HIGH.diffuse.march, start_offset_voxels=1e-5),
    )
    return replace(
        HIGH,
        diffuse=diffuse,
        samples_per_pixel=2,
        ambient=replace(HIGH.ambient, range_share=None, range_world=2.5),
        clipmap=replace(HIGH.clipmap, centre=(0.1, 2.0, -3.0)),
    )


def write(path: Path, config: RenderConfig, record: dict[str, object] | None = None) -> Path:
    changes, unset = config_changes(HIGH, config)
    file = PresetFile(base="high", changes=changes, unset=unset, record=record or {})
    write_preset_file(path, file)
    return path


def test_a_configuration_comes_back(tmp_path: Path) -> None:
    assert preset(str(write(tmp_path / "mine.toml", fitted()))) == fitted()


def test_an_unchanged_configuration_is_an_empty_file(tmp_path: Path) -> None:
    path = write(tmp_path / "mine.toml", HIGH)
    assert read_preset_file(path).changes == {}
    assert preset(str(path)) == HIGH


@given(
    text=st.text(st.characters(exclude_categories=["Cs"])),
    numbers=st.lists(st.floats(allow_nan=False)),
    whole=st.integers(-(2**63), 2**63 - 1),
    key=st.text(st.characters(exclude_categories=["Cs"]), min_size=1),
)
def test_a_record_comes_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, text: str, numbers: list[float], whole: int, key: str
) -> None:
    record: dict[str, object] = {
        "text": text,
        "numbers": numbers,
        "table": {key: whole, "inner": {"yes": True}},
    }
    path = write(tmp_path_factory.getbasetemp() / "record.toml", HIGH, record)
    found = read_preset_file(path).record
    expected: dict[str, object] = {**record, "table": {"inner": {"yes": True}, key: whole}}
    if key == "inner":
        expected["table"] = {"inner": whole}
        return
    assert found == expected


def test_a_write_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    path = write(tmp_path / "mine.toml", fitted())
    before = path.read_bytes()
    with pytest.raises(TypeError, match="has no place"):
        write(path, HIGH, {"thing": object()})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_the_plugin_takes_a_file(variant: str, tmp_path: Path) -> None:
    path = write(tmp_path / "mine.toml", fitted())
    plugin = mi.load_dict({"type": "vctgi", "preset": str(path)})
    assert plugin.config.diffuse == fitted().diffuse


def test_a_shipped_file_is_a_preset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "high-mine.toml", fitted())
    monkeypatch.setattr(config_module, "SHIPPED_FOLDER", tmp_path)
    config_module.shipped_presets.cache_clear()
    try:
        assert "high-mine" in preset_names()
        assert preset("high-mine") == fitted()
        write(tmp_path / "loop.toml", HIGH)
        text = (tmp_path / "loop.toml").read_text().replace('"high"', '"high-mine"')
        (tmp_path / "loop.toml").write_text(text)
        with pytest.raises(PresetFileError, match="base is 'high-mine'"):
            preset(str(tmp_path / "loop.toml"))
    finally:
        config_module.shipped_presets.cache_clear()


def test_all_shipped_files_can_be_used() -> None:
    for name, path in config_module.shipped_presets().items():
        assert preset(name).mode == "indirect"
        assert read_preset_file(path).record["command"].startswith("vctgi optimize")


GOOD = 'format = 1\nbase = "high"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("format = ", "not TOML"),
        ("\xff", "not TOML"),
        ('base = "high"\n', "format is None"),
        ('format = 2\nbase = "high"\n', "format is 2"),
        ("format = 1\n", "'base' is missing"),
        ("format = 1\nbase = 3\n", "'base' is missing or not a str"),
        (GOOD + "colour = 1\n", "no key 'colour'"),
        ('format = 1\nbase = "best"\n', "base is 'best'"),
        (GOOD + "[config]\nspeed = 1\n", "no field 'config.speed'"),
        (GOOD + "[config.diffuse]\nspeed = 1\n", "no field 'config.diffuse.speed'"),
        (GOOD + '[config.diffuse]\naperture_scale = "wide"\n', "is 'wide', a str"),
        (GOOD + "[config.diffuse]\naperture_scale = true\n", "a bool"),
        (GOOD + "[config.diffuse]\ncone_count = 9.0\n", "a float"),
        (GOOD + "[config]\ndiffuse = 3\n", "'config.diffuse' is 3"),
        (GOOD + '[config.diffuse]\nrotation = "often"\n', "'often'"),
        (GOOD + "[config.diffuse]\naperture_scale = -1.0\n", "must be > 0"),
        (GOOD + "[config.clipmap]\ncentre = [1.0, 2.0]\n", "a list"),
        ('format = 1\nbase = "high"\nunset = ["samples_per_pixel"]\n', "is None"),
        ('format = 1\nbase = "high"\nunset = ["nothing.at.all"]\n', "no field 'config.nothing'"),
    ],
)
def test_what_is_wrong_is_one_line(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(PresetFileError) as found:
        preset(str(path))
    line = str(found.value)
    assert words in line
    assert "bad.toml" in line
    assert "\n" not in line
    assert found.value.remedy


def test_a_missing_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(PresetFileError, match="cannot be read"):
        preset(str(tmp_path / "none.toml"))


def test_whole_numbers_are_taken_for_floats(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(GOOD + "[config.diffuse]\naperture_scale = 2\n")
    assert tomllib.loads(path.read_text())["config"]["diffuse"]["aperture_scale"] == 2
    assert isinstance(preset(str(path)).diffuse.aperture_scale, float)
