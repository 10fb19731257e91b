"""Recipes of other systems are presets, with their scale only where it is asked for."""

from __future__ import annotations

import pytest

from vctgi.config import PRESETS, preset, preset_names
from vctgi.peers import PEERS


@pytest.mark.parametrize("name", PEERS)
def test_every_recipe_is_a_preset_without_a_scale(name: str) -> None:
    config = preset(f"peer:{name}")
    assert config.diffuse == PEERS[name].diffuse
    assert config.diffuse.gain == 1.0
    assert config.downsampling == PEERS[name].downsampling
    assert config.clipmap == PRESETS["high"].clipmap
    assert f"peer:{name}" in preset_names()


@pytest.mark.parametrize(
    ("name", "gain"), [("compix", 0.5 * 15.0), ("wicked", 0.5), ("cigg", 4.0), ("crassin", 1.0)]
)
def test_the_published_scale_is_applied_only_when_asked_for(name: str, gain: float) -> None:
    assert preset(f"peer:{name}:published").diffuse.gain == gain
    assert PEERS[name].published_gain == gain


@pytest.mark.parametrize("name", ["peer:none", "none", "peer:", "compix"])
def test_unknown_names_list_the_known_ones(name: str) -> None:
    with pytest.raises(ValueError, match="compix"):
        preset(name)
