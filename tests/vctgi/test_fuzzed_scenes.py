"""Random scenes give finite light that is not negative, or one clear line that says why not."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.vctgi.fuzzed_scenes import PALETTES, FuzzedScene, Palette, render, scenes
from vctgi.errors import SceneError

pytestmark = pytest.mark.usefixtures("variant")

FEW, MANY = 10, 100
"""Scenes of each palette in the normal suite, which takes two of them, and in the slow one."""

QUICK = ("diffuse", "metal")

SIGNED = ("normal", "position")
"""Pictures of what is no light."""


def check(scene: FuzzedScene, palette: Palette) -> None:
    found = render(scene, palette)
    if isinstance(found, SceneError):
        message = str(found)
        assert message
        assert "\n" not in message
        return
    for name, picture in found.items():
        assert np.isfinite(picture).all(), name
        assert name in SIGNED or picture.min() >= 0.0, name


@pytest.mark.parametrize("name", QUICK)
def test_a_few_random_scenes_give_sound_light(name: str) -> None:
    palette = PALETTES[name]

    @settings(max_examples=FEW, suppress_health_check=[HealthCheck.too_slow])
    @given(scenes(palette))
    def run(scene: FuzzedScene) -> None:
        check(scene, palette)

    run()


@pytest.mark.slow
@pytest.mark.timeout(900)  # A minute by itself, and several on a machine that is busy
@pytest.mark.parametrize("name", PALETTES)
def test_many_random_scenes_give_sound_light(name: str) -> None:
    palette = PALETTES[name]

    @settings(max_examples=MANY, suppress_health_check=[HealthCheck.too_slow])
    @given(scenes(palette), st.just(None))
    def run(scene: FuzzedScene, _: None) -> None:
        check(scene, palette)

    run()
    gc.collect()
