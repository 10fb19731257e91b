"""A reference rendered to a noise target: how noisy it is, when it stops, what a kill costs."""

from __future__ import annotations

import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import metrics
from reference import (
    NoisyReferenceError,
    Reference,
    ReferenceRequest,
    ReferenceTarget,
    noise_floor,
    render_reference,
    render_to_target,
    require_low_noise,
)
from reference.noise import LEVEL, noise_of
from reference.target import PILOT_BATCH_SAMPLES
from tests.reference import reference_scenes as scenes

REPOSITORY = Path(__file__).parents[2]
TARGET = ReferenceTarget(relmse=1e-3)
PILOT = 4 * PILOT_BATCH_SAMPLES


def render(cache: Path | None = None, target: ReferenceTarget = TARGET, **more: Any) -> Reference:
    scene = mi.load_dict(scenes.textured())
    return render_to_target(scene, target=target, cache_directory=cache, **more)


def synthetic(
    count: int, relmse: float, seed: int = 0, shape: tuple[int, int] = (24, 24)
) -> np.ndarray:
    """Grey batches whose mean has a noise relMSE that is known in closed form.

    Around the level 1 the noise is s^2 / M / (1 + 0.01).
    """
    random = np.random.default_rng(seed)
    deviation = np.sqrt(relmse * 1.01 * count)
    batches: np.ndarray = 1.0 + deviation * random.standard_normal((count, *shape, 3))
    return batches.astype(np.float32)


def reference_of(batches: np.ndarray) -> Reference:
    nothing = np.zeros_like(batches)
    return Reference(
        components={
            "emission": nothing,
            "direct": batches,
            "indirect_diffuse": nothing,
            "indirect_specular": nothing,
        },
        key="0123456789abcdef",
        request=ReferenceRequest(samples_per_pixel=8 * len(batches), batch_count=len(batches)),
        seconds=0.0,
        from_cache=False,
        notes=[],
    )


def test_the_noise_of_synthetic_batches_is_the_known_one() -> None:
    floors = [noise_of(synthetic(8, 1e-3, seed), 64) for seed in range(400)]
    values = np.array([floor.value for floor in floors])
    error = values.std(ddof=1) / np.sqrt(len(values))
    # R^2 of a noisy mean is larger by its variance: 1e-3 of a relative 1e-3
    assert abs(values.mean() - 1e-3) < 5.0 * error + 4e-6
    covered = np.mean([floor.upper >= 1e-3 for floor in floors])
    # Three standard errors of a share of 400
    assert abs(covered - LEVEL) < 3.0 * np.sqrt(LEVEL * (1 - LEVEL) / 400)


def test_it_is_the_noise_that_metrics_report() -> None:
    reference = render_reference(
        mi.load_dict(scenes.textured()),
        request=ReferenceRequest(samples_per_pixel=512, batch_count=8),
        cache_directory=None,
    )
    # Theirs divides by other batches than it takes the spread of, which costs a cube of their
    # number; ours is some percent off by that, within the interval of theirs
    theirs = metrics.reference_noise_relmse(reference.batches("image"))
    assert theirs.low <= noise_floor(reference).value <= theirs.high


def test_rendering_stops_as_soon_as_the_target_is_reached(tmp_path: Path) -> None:
    reference = render(tmp_path)
    floor = noise_floor(reference)
    assert floor.upper <= TARGET.relmse
    # One batch less was not enough
    fewer = reference.batches("image")[:-1]
    assert len(fewer) < 4 or noise_of(fewer, 0).upper > TARGET.relmse
    # And the true error, against a far better reference, is what was promised
    truth = render_reference(
        mi.load_dict(scenes.textured()),
        request=ReferenceRequest(samples_per_pixel=1 << 14, seed=5, rest_samples_per_pixel=0),
        cache_directory=None,
    ).mean("image")
    epsilon = 0.01 * float((truth @ [0.212671, 0.715160, 0.072169]).mean()) ** 2
    error = float(np.mean((reference.mean("image") - truth) ** 2 / (truth**2 + epsilon)))
    assert 0.5 * TARGET.relmse < error < 1.5 * TARGET.relmse


def test_an_easy_target_takes_the_pilot_alone() -> None:
    assert render(target=replace(TARGET, relmse=1.0)).request.samples_per_pixel == PILOT


def test_a_lower_target_goes_on_with_the_batches_of_a_higher_one(tmp_path: Path) -> None:
    high = render(tmp_path, replace(TARGET, relmse=8e-4))
    low = render(tmp_path, replace(TARGET, relmse=7e-4))
    assert low.key == high.key
    count = high.request.batch_count
    assert low.request.batch_count >= count
    assert low.batches("direct")[:count].tobytes() == high.batches("direct").tobytes()
    again = render(tmp_path, replace(TARGET, relmse=7e-4))
    assert again.from_cache
    assert again.batches("image").tobytes() == low.batches("image").tobytes()


def test_a_target_out_of_reach_is_refused_with_the_paths_that_it_needs() -> None:
    target = replace(TARGET, relmse=1e-6, most_samples_per_pixel=128)
    with pytest.raises(NoisyReferenceError, match=r"needs about \d+ paths a pixel, more than the"):
        render(target=target)


def test_a_dark_scene_has_no_noise_that_could_be_relative() -> None:
    scene = scenes.textured()
    del scene["light"]
    with pytest.raises(NoisyReferenceError, match="no light in 'image'"):
        render_to_target(mi.load_dict(scene), target=TARGET, cache_directory=None)


@pytest.mark.parametrize(
    "fields",
    [{"relmse": 0.0}, {"most_samples_per_pixel": 8}, {"seed": -1}, {"scattering_count": 0}],
)
def test_bad_targets_name_the_field(fields: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=rf"\.{next(iter(fields))} must be "):
        ReferenceTarget(**{"relmse": 1.0, **fields})


def test_progress_never_falls_and_ends_at_one(tmp_path: Path) -> None:
    for _ in ("rendered", "read"):
        shares: list[float] = []
        render(tmp_path, progress=shares.append)
        assert shares == sorted(shares)
        assert shares[0] < 0.1
        assert shares[-1] == 1.0


KILLED = """
import os, pathlib, signal
import mitsuba as mi
mi.set_variant({variant!r})
import reference.batch_run as batch_run
from reference import ReferenceTarget, render_to_target
from tests.reference import reference_scenes as scenes

finished = []
keep = batch_run.write_batch

def keep_some(entry, index, batch):
    keep(entry, index, batch)
    finished.append(entry)
    if len(finished) == {count}:
        os.kill(os.getpid(), signal.SIGKILL)

batch_run.write_batch = keep_some
render_to_target(
    mi.load_dict(scenes.textured()),
    target=ReferenceTarget(relmse={relmse}),
    cache_directory=pathlib.Path({cache!r}),
)
"""
KILLED_AFTER = 7
"""Four batches of the pilot and three of the others."""


def test_a_killed_run_goes_on_with_the_batches_it_has(tmp_path: Path) -> None:
    code = KILLED.format(
        variant=mi.variant(), count=KILLED_AFTER, relmse=TARGET.relmse, cache=str(tmp_path)
    )
    killed = subprocess.run(
        [sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("batch_*.npz")}
    assert len(kept) == KILLED_AFTER
    assert not list(tmp_path.rglob("*.tmp"))
    resumed, fresh = render(tmp_path), render()
    assert resumed.components.keys() == fresh.components.keys()
    for name, batches in fresh.components.items():
        assert batches.tobytes() == resumed.components[name].tobytes(), name
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_a_comparison_below_the_noise_is_refused_in_one_line() -> None:
    reference = reference_of(synthetic(8, 1e-3))
    require_low_noise(reference, 1.2e-2)
    with pytest.raises(NoisyReferenceError) as refused:
        require_low_noise(reference, 9e-3)
    message = str(refused.value)
    assert "\n" not in message
    assert "'image' of reference 0123456789ab is too noisy to compare" in message
    assert "not 10 times below 0.009" in message
    assert "paths a pixel in place of 64" in message


def test_what_nobody_can_tell_is_refused_too() -> None:
    with pytest.raises(NoisyReferenceError, match="3 batches do not say"):
        require_low_noise(reference_of(synthetic(3, 1e-3)), 1.0)
    with pytest.raises(NoisyReferenceError, match=r"'indirect' of .* has no light"):
        require_low_noise(reference_of(synthetic(8, 1e-3)), 1.0, ["image", "indirect"])
    with pytest.raises(ValueError, match="smallest_difference must be above 0"):
        require_low_noise(reference_of(synthetic(8, 1e-3)), 0.0)
