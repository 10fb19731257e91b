"""What a sweep file may say, and which jobs it means."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from experiments.errors import InputError
from experiments.sweep.jobs import Job, list_jobs
from experiments.sweep.overrides import changed_config
from experiments.sweep.specification import SweepSpec, load_sweep, parse_set
from vctgi.config import preset

FILE = """
scenes = ["cornell_box", "corridor"]
presets = ["medium", "high"]
seeds = [0, 3]
reference_spp = 64
[parameters]
samples_per_pixel = [1, 2]
"diffuse.aperture_scale" = [1.0]
diffuse.march.level_bias = [-1.0, -0.5]
"""


def jobs_of(spec: SweepSpec, **changes: Any) -> dict[str, Job]:
    about: dict[str, Any] = {
        "variant": "llvm_ad_rgb",
        "digest_variant": "llvm_ad_rgb",
        "cache": None,
        "code": "c0de",
    }
    digests = {scene: f"digest of {scene}" for scene in spec.scenes}
    return list_jobs(spec, changes.pop("digests", digests), **about | changes)


def spec_of(folder: Path, text: str = FILE, **given: Any) -> SweepSpec:
    path = folder / "sweep.toml"
    path.write_text(text, encoding="utf-8")
    return load_sweep(path, given)


def test_every_combination_is_a_job(tmp_path: Path) -> None:
    jobs = jobs_of(spec_of(tmp_path))
    assert len(jobs) == 2 * 2 * 2 * 1 * 2 * 2
    assert all(job.key == key for key, job in jobs.items())
    job = next(iter(jobs.values()))
    expected = "medium, samples_per_pixel=1, diffuse.aperture_scale=1.0, diffuse.march.level_bias="
    assert job.label == f"cornell_box, {expected}-1.0, seed 0"
    assert job.config().diffuse.march.level_bias == -1.0
    assert job.config().samples_per_pixel == 1
    assert Job.model_validate_json(job.model_dump_json()) == job


def test_the_example_is_sixteen_jobs() -> None:
    example = Path(__file__).parents[3] / "experiments" / "examples" / "sweep.toml"
    assert len(jobs_of(load_sweep(example, {}))) == 16


def test_options_take_the_place_of_entries(tmp_path: Path) -> None:
    spec = spec_of(tmp_path, seeds=[7], parameters={})
    assert {job.seed for job in jobs_of(spec).values()} == {7}
    assert load_sweep(None, {"scenes": ["corridor"]}).presets == ["high"]


def test_equal_jobs_are_one(tmp_path: Path) -> None:
    same = float(preset("medium").diffuse.aperture_scale)
    text = 'scenes = ["corridor"]\npresets = ["medium", "medium"]\n'
    spec = spec_of(tmp_path, text, parameters={"diffuse.aperture_scale": [same, same]})
    assert len(jobs_of(spec)) == 1


@pytest.mark.parametrize(
    "change",
    [
        {"code": "other"},
        {"digests": {"corridor": "other"}},
        {"variant": "cuda_ad_rgb"},
        {"spec": {"reference_spp": 128}},
        {"spec": {"resolution": 64}},
        {"spec": {"seeds": [1]}},
        {"spec": {"sensor": 1}},
        {"spec": {"parameters": {"samples_per_pixel": [3]}}},
        {"spec": {"presets": ["ultra"]}},
    ],
    ids=str,
)
def test_the_key_changes_with_all_that_the_result_depends_on(change: dict[str, Any]) -> None:
    base = SweepSpec(scenes=["corridor"])
    [key] = jobs_of(base)
    other = base.model_copy(update=change.pop("spec", {}))
    assert [key] != list(jobs_of(other, **change))


def test_the_key_does_not_change_with_the_rest(tmp_path: Path) -> None:
    base = SweepSpec(scenes=["corridor"])
    assert list(jobs_of(base)) == list(jobs_of(base, cache=tmp_path, digest_variant="cuda_ad_rgb"))


def test_a_job_can_be_made_again_by_its_command(tmp_path: Path) -> None:
    text = 'scenes = ["corridor"]\nresolution = 64\n[parameters]\nsky_lighting = ["cones"]\n'
    [job] = jobs_of(spec_of(tmp_path, text)).values()
    assert job.command == (
        "vctgi sweep --scene corridor --preset high --set 'sky_lighting=\"cones\"' --seeds 0 "
        "--spp 512 --resolution 64 --variant llvm_ad_rgb --sensor 0"
    )
    assert parse_set(['sky_lighting="cones"']) == {"sky_lighting": ["cones"]}


def test_values_on_the_command_line_are_toml_or_words() -> None:
    given = parse_set(["a=1,2.5", "b=maps,cones", "c=true", "d=[1, 2],[3, 4]", "e=-1"])
    assert given == {
        "a": [1, 2.5],
        "b": ["maps", "cones"],
        "c": [True],
        "d": [[1, 2], [3, 4]],
        "e": [-1],
    }


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("scenes = []", "scenes: List should have at least 1 item"),
        ("presets = ['high']", "scenes: Field required"),
        ("scenes = ['a']\nsede = [1]", "sede: unknown key"),
        ("scenes = ['a']\nseeds = ['1']", r"seeds\[0\]: Input should be a valid integer"),
        ("scenes = ['a']\nreference_spp = 12", "reference_spp: Input should be a multiple of 8"),
        ("scenes = ['a']\nresolution = 4", "greater than or equal to 16"),
        ("scenes = ['a']\n[parameters]\na = 1", "parameters.a: Input should be a valid list"),
        ("scenes = ['a']\n[parameters]\na = []", "parameter 'a' has no value"),
        ("scenes = [", "not TOML"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        spec_of(tmp_path, text)


@pytest.mark.parametrize("word", ["a", "=1", "a="])
def test_a_parameter_of_another_form_is_refused(word: str) -> None:
    with pytest.raises(InputError, match="NAME=VALUE"):
        parse_set([word])


def test_nothing_to_sweep_is_refused() -> None:
    with pytest.raises(InputError, match="nothing to sweep"):
        load_sweep(None, {})
    with pytest.raises(InputError, match="cannot read"):
        load_sweep(Path("nowhere.toml"), {})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"diffuse.cones": 3}, "no field 'diffuse.cones'.*diffuse.cone_count"),
        ({"diffuse": 3}, "'diffuse' does not name one value"),
        ({"samples_per_pixel.x": 3}, "'samples_per_pixel' does not name one value"),
        ({"diffuse.march": 3, "diffuse.march.level_bias": 1}, "does not name one value"),
        ({"samples_per_pixel": 1.5}, "valid integer.*samples_per_pixel = 1.5"),
        ({"samples_per_pixel": True}, "valid integer"),
        ({"sky_lighting": "lamps"}, "'maps' or 'cones'"),
        ({"samples_per_pixel": 0}, "must be >= 1.*samples_per_pixel"),
    ],
)
def test_a_value_that_no_configuration_takes_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        changed_config(preset("high"), values)


def test_values_keep_the_types_of_their_fields() -> None:
    config = changed_config(preset("high"), {"diffuse.march.level_bias": -1, "sky_in_cones": True})
    assert config.diffuse.march.level_bias == -1.0
    assert config.sky_in_cones is True
    assert changed_config(preset("high"), {}) == preset("high")
