"""The command line: exit codes, one line for bad input, and the main job on a small scene."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import OpenEXR
import pytest

import vctgi
from experiments.cli import main
from experiments.errors import EXIT_BAD_INPUT, EXIT_DONE, InputError
from experiments.run import RunOptions, run_scene
from experiments.scenes import LoadedScene
from experiments.session import list_presets
from reports.record import Record, load_image, read_record, read_records
from vctgi.config import RenderConfig, preset, preset_names

SMALL_REPORT = ["--resolution", "32", "--spp", "64", "--preset", "medium"]

SCENE = """<scene version="3.0.0">
  <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="32"/>
    <integer name="height" value="32"/></film>
    <transform name="to_world"><lookat origin="0,1,4" target="0,1,0" up="0,1,0"/></transform>
  </sensor>
  {light}
  <shape type="rectangle"><transform name="to_world"><scale value="3"/>
    <rotate x="1" angle="-90"/></transform>{bsdf}</shape>
  <shape type="cube"><transform name="to_world"><scale value="0.5"/>
    <translate y="0.5"/></transform></shape>
</scene>"""
LIGHT = '<emitter type="point"><point name="position" x="0" y="3" z="1"/></emitter>'


def write_scene(folder: Path, *, light: str = LIGHT, bsdf: str = "") -> Path:
    path = folder / "scene.xml"
    path.write_text(SCENE.format(light=light, bsdf=bsdf), encoding="utf-8")
    return path


def refused_line(capsys: pytest.CaptureFixture[str]) -> str:
    """Return the one line that a refused command prints."""
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line.startswith("vctgi: ")]
    assert len(lines) == 1, captured.err
    assert "Traceback" not in captured.err
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["report", "nowhere.xml"], "nowhere.xml"),
        (["report", "no_such_scene"], "cornell_box"),
        (["report", "cornell_box", "--preset", "best"], "use ambient, medium, high, ultra"),
        (["report", "cornell_box", "--preset", "ambient"], "no light"),
        (["report", "cornell_box", "--spp", "12"], "multiple of 8"),
        (["report", "cornell_box", "--spp", "0"], "at least 8"),
        (["report", "cornell_box", "--resolution", "4"], "at least 16"),
        (["report", "cornell_box", "--resolution", "many"], "--resolution"),
        (["report", "cornell_box", "--variant", "scalar_rgb"], "llvm_ad_rgb"),
        (["report", "cornell_box", "--sensor", "3"], "camera 3"),
        (["report", "--no-such-option"], "--no-such-option"),
        (["reprot"], "reprot"),
        (["plan"], "scene"),
        (["gate", "nowhere.toml"], "nowhere.toml"),
        (["gate", "--update"], "--reason"),
        (["render", "cornell_box"], "--output"),
        (["render", "cornell_box", "-o", "frame.exr", "--seed", "-1"], "at least 0"),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(
    arguments: list[str],
    words: str,
    variant: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == EXIT_BAD_INPUT
    assert words.lower() in refused_line(capsys).lower()
    assert not list(tmp_path.iterdir()), "what is refused must leave nothing"


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ({"light": ""}, "light"),
        ({"bsdf": '<bsdf type="no_such_bsdf"/>'}, "no_such_bsdf"),
    ],
)
def test_a_scene_that_cannot_be_rendered_is_one_line(
    scene: dict[str, str],
    words: str,
    variant: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = write_scene(tmp_path, **scene)
    assert main(["report", str(path), "--output", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    assert words in refused_line(capsys)


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="needs a folder that nobody may write to")
def test_a_folder_that_cannot_be_written_is_refused_before_rendering(
    variant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", "cornell_box", "--output", "/proc/vctgi-report"]) == EXIT_BAD_INPUT
    assert "--output" in refused_line(capsys)


def test_an_output_that_is_a_file_is_refused(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "taken"
    path.write_text("in the way", encoding="utf-8")
    assert main(["report", "cornell_box", "--output", str(path)]) == EXIT_BAD_INPUT
    assert "--output" in refused_line(capsys)
    assert path.read_text(encoding="utf-8") == "in the way"


def test_a_scene_file_that_exits_is_refused(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "exits.py"
    path.write_text("import sys\nsys.exit(0)\n", encoding="utf-8")
    assert main(["plan", str(path)]) == EXIT_BAD_INPUT
    assert "SystemExit" in refused_line(capsys)


def test_a_mesh_whose_faces_name_no_vertex_is_refused(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "stray.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
        encoding="utf-8",
    )
    assert main(["plan", str(path)]) == EXIT_BAD_INPUT
    assert "name no vertex" in refused_line(capsys)


@pytest.mark.parametrize("power", ["nan", "-1"])
def test_a_light_of_no_possible_power_is_refused(
    power: str, variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light = LIGHT.replace("</emitter>", f'<rgb name="intensity" value="{power}"/></emitter>')
    path = write_scene(tmp_path, light=light)
    assert main(["report", str(path), "--output", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    assert "'intensity.value' are negative, infinite or NaN" in refused_line(capsys)


def test_a_picture_without_light_is_refused_and_the_other_scenes_get_their_page(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    light = LIGHT.replace("</emitter>", '<rgb name="intensity" value="0"/></emitter>')
    path = write_scene(tmp_path, light=light)
    output = tmp_path / "out"
    common = ["--output", str(output), "--cache", str(tmp_path / "cache"), *SMALL_REPORT]
    assert main(["report", str(path), *common]) == EXIT_BAD_INPUT
    assert "sees no light" in refused_line(capsys)
    assert not (output / "index.html").exists()
    assert main(["report", str(path), "cornell_box", *common]) == EXIT_BAD_INPUT
    assert "Cornell box" in (output / "index.html").read_text(encoding="utf-8")


def test_several_presets_share_a_page_and_a_failing_one_is_left_out(
    variant: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    real_preset, real_run = vctgi.preset, run_scene

    def small_preset(name: str) -> RenderConfig:
        config = real_preset(name)
        clipmap = replace(config.clipmap, resolution=32)
        return replace(config, clipmap=clipmap, samples_per_pixel=1)

    def failing_run(loaded: LoadedScene, options: RunOptions, *rest: Any) -> tuple[Record, Path]:
        if options.preset == "peer:godot_lq":
            raise InputError(what="it fails", where=options.preset, remedy="none")
        return real_run(loaded, options, *rest)

    monkeypatch.setattr(vctgi, "preset", small_preset)
    monkeypatch.setattr("experiments.report.run_scene", failing_run)
    output = tmp_path / "out"
    presets = ["--preset", "peer:godot_lq", "--preset", "medium,peer:crassin:published"]
    arguments = ["report", str(write_scene(tmp_path)), "--output", str(output), *presets]
    arguments += ["--resolution", "32", "--spp", "16", "--cache", str(tmp_path / "cache")]
    assert main(arguments) == EXIT_BAD_INPUT
    assert "it fails" in (said := capsys.readouterr().err)
    assert "[2/3]" in said
    assert "peer:crassin:published: cone tracing" in said
    records = read_records(output / "records").values()
    assert sorted(record.preset for record in records) == ["medium", "peer:crassin:published"]
    assert len({record.reference.key for record in records if record.reference}) == 1
    # Rendered once, and read from the cache by the others.
    assert sorted(r.reference.from_cache for r in records if r.reference) == [False, True]
    for record in records:
        assert f"--preset {record.preset} " in record.command
        assert record.cost is not None
        assert record.cost.gathering_samples >= record.cost.gathering_cones > 0
        assert record.cost.voxel_bytes > 0
    page = (output / "index.html").read_text(encoding="utf-8")
    assert "Methods side by side" in page


def test_presets_are_named_by_lists_and_by_words() -> None:
    assert list_presets(["high"]) == ["high"]
    assert list_presets(["all"]) == ["medium", "high", "ultra"]
    assert list_presets(["ultra, medium", "all"]) == ["ultra", "medium", "high"]
    peers = list_presets(["peers"])
    assert set(peers) <= set(preset_names())
    assert {"peer:compix", "peer:compix:published", "peer:hanetaka8"} <= set(peers)
    # A scale of one is no other recipe.
    gains = {name: preset(name).diffuse.gain for name in peers if name.endswith(":published")}
    assert gains
    assert 1.0 not in gains.values()
    for wrong in (["best"], ["all,best"], ["ambient"], [","]):
        with pytest.raises(InputError):
            list_presets(wrong)


def test_a_picture_without_indirect_light_is_measured_where_it_can_be(
    variant: str, tmp_path: Path
) -> None:
    path = tmp_path / "one.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
        "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
        encoding="utf-8",
    )
    output = tmp_path / "out"
    arguments = ["report", str(path), "--output", str(output), *SMALL_REPORT]
    assert main([*arguments, "--cache", str(tmp_path / "cache")]) == EXIT_DONE
    (record,) = read_records(output / "records").values()
    assert record.reference is not None
    assert record.reference.noise_relmse is None
    assert {m.name for m in record.metrics if m.component == "image"} >= {"energy_ratio", "flip"}


def test_a_picture_that_is_too_narrow_is_refused(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_scene(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('name="width" value="32"', 'name="width" value="1"'), "utf-8")
    assert main(["report", str(path), "--output", str(tmp_path / "out")]) == EXIT_BAD_INPUT
    assert "too small to measure" in refused_line(capsys)


def test_a_film_with_a_crop_window_keeps_its_size(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_scene(tmp_path)
    crop = "".join(
        f'<integer name="crop_{name}" value="{value}"/>'
        for name, value in {"width": 20, "height": 16, "offset_x": 6, "offset_y": 8}.items()
    )
    film = '<film type="hdrfilm">'
    path.write_text(path.read_text(encoding="utf-8").replace(film, film + crop), encoding="utf-8")
    output = tmp_path / "out"
    arguments = ["report", str(path), "--output", str(output), "--spp", "64"]
    arguments += ["--preset", "medium", "--cache", str(tmp_path / "cache")]
    assert main(arguments) == EXIT_DONE
    (record,) = read_records(output / "records").values()
    assert (record.width, record.height) == (20, 16)
    capsys.readouterr()
    assert main([*arguments, "--resolution", "32"]) == EXIT_BAD_INPUT
    assert "crop" in refused_line(capsys)


def test_debug_adds_the_traceback_before_the_line(
    variant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", "no_such_scene", "--debug"]) == EXIT_BAD_INPUT
    assert "Traceback" in capsys.readouterr().err


def test_report_makes_a_page_of_records_for_a_built_in_scene_and_a_file(
    variant: str, tmp_path: Path
) -> None:
    scene = write_scene(tmp_path)
    output = tmp_path / "report"
    results = tmp_path / "results.json"
    arguments = ["report", "cornell_box", str(scene), "--output", str(output)]
    arguments += ["--cache", str(tmp_path / "cache"), "--json", str(results), *SMALL_REPORT]
    assert main(arguments) == EXIT_DONE

    page = (output / "index.html").read_text(encoding="utf-8")
    records = read_records(output / "records")
    assert len(records) == len(json.loads(results.read_text(encoding="utf-8"))) == 2
    for path, record in records.items():
        assert record.scene.title in page
        assert record.machine.backend == variant
        assert {stage.stage for stage in record.times} >= {"frame", "diffuse cones"}
        assert record.reference is not None
        assert record.reference.scattering_count == 2
        # What the page compares is emission + direct + indirect of either side.
        image, error = (load_image(path, record, name) for name in ("image", "error"))
        assert image - error == pytest.approx(load_image(path, record, "reference"), abs=1e-5)
    assert (output / "sheet.jpg").stat().st_size > 0
    assert (output / "summary.md").read_text(encoding="utf-8").count("\n|") >= 3

    # A second run reads the references it has.
    assert main(arguments) == EXIT_DONE
    again = [r for r in read_records(output / "records").values() if r.reference]
    assert sum(r.reference is not None and r.reference.from_cache for r in again) == 2


def test_the_same_run_gives_the_same_numbers(variant: str, tmp_path: Path) -> None:
    measured = []
    for number in range(2):
        output = tmp_path / str(number)
        arguments = ["report", "cornell_box", "--output", str(output), *SMALL_REPORT]
        assert main([*arguments, "--cache", str(tmp_path / "cache")]) == EXIT_DONE
        (record,) = read_records(output / "records").values()
        measured.append([(m.component, m.name, m.value) for m in record.metrics])
    assert measured[0] == measured[1]


def test_plan_says_what_is_left_out(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entries = tmp_path / "plan.json"
    assert main(["plan", "cornell_box", "--json", str(entries)]) == EXIT_DONE
    shown = capsys.readouterr().out
    by_item = {e["item"]: e for e in json.loads(entries.read_text(encoding="utf-8"))}
    assert not by_item["specular cones"]["kept"]
    assert "no material has a glossy" in shown


def test_render_and_reference_write_named_channels(variant: str, tmp_path: Path) -> None:
    import OpenEXR

    frame, truth = tmp_path / "frame.exr", tmp_path / "truth.exr"
    small = ["--resolution", "32"]
    assert main(["render", "cornell_box", "-o", str(frame), "--preset", "medium", *small]) == 0
    cache = ["--cache", str(tmp_path / "cache")]
    assert main(["reference", "cornell_box", "-o", str(truth), "--spp", "64", *small, *cache]) == 0
    with OpenEXR.File(str(frame), separate_channels=True) as file:
        names = set(file.channels())
        assert {"R", "direct.R", "indirect_diffuse.G", "albedo.B", "normal.X", "depth.Z"} <= names
    with OpenEXR.File(str(truth), separate_channels=True) as file:
        assert {"R", "emission.R", "variance_indirect_diffuse.B"} <= set(file.channels())


def test_a_reference_is_rendered_to_a_noise_target(
    variant: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "truth.exr"
    common = ["reference", str(write_scene(tmp_path)), "-o", str(output), "--resolution", "32"]
    common += ["--cache", str(tmp_path / "cache")]
    assert main([*common, "--target-relmse", "0.02"]) == EXIT_DONE
    shown = capsys.readouterr().out
    assert "paths a pixel, noise relMSE" in shown
    assert "enough for differences from" in shown
    with OpenEXR.File(str(output), separate_channels=True) as file:
        assert {"R", "emission.R", "variance_rest.B"} <= set(file.channels())
    assert main([*common, "--target-relmse", "1e-9", "--spp", "128"]) == EXIT_BAD_INPUT
    line = refused_line(capsys)
    assert "more than the 128 that are allowed" in line
    assert "raise --spp or --target-relmse" in line
    assert main([*common, "--target-relmse", "0"]) == EXIT_BAD_INPUT
    assert "relmse must be above 0" in refused_line(capsys)


def test_a_record_names_how_to_make_it_again(variant: str, tmp_path: Path) -> None:
    output = tmp_path / "out"
    cache = ["--cache", str(tmp_path / "cache")]
    assert main(["report", "cornell_box", "--output", str(output), *SMALL_REPORT, *cache]) == 0
    (path,) = (output / "records").glob("*.json")
    command = read_record(path).command
    assert command.startswith("vctgi report cornell_box --preset medium --resolution 32 --spp 64")


def test_ambient_occlusion_of_an_unlit_scene_is_a_channel(variant: str, tmp_path: Path) -> None:
    path, output = write_scene(tmp_path, light=""), tmp_path / "open.exr"
    assert main(["render", str(path), "-o", str(output), "--preset", "ambient"]) == EXIT_DONE
    with OpenEXR.File(str(output), separate_channels=True) as file:
        channels = {name: each.pixels for name, each in file.channels().items()}
    assert set(channels) == {
        *("R", "G", "B", "ambient.Y", "albedo.R", "albedo.G", "albedo.B"),
        *("normal.X", "normal.Y", "normal.Z", "depth.Z"),
    }
    assert 0.0 < channels["ambient.Y"].min() < channels["ambient.Y"].max() <= 1.0
    assert main(["plan", str(path), "--preset", "ambient"]) == EXIT_DONE
    assert main(["plan", str(path), "--preset", "medium"]) == EXIT_BAD_INPUT
