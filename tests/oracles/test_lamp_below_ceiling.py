"""A ceiling less than a voxel above the back of a lamp is dark, though both share their voxels.

The lamp's back is in no slot, because nothing lights it and nobody sees it. It is in the way all
the same: what points between ceiling and lamp get comes through the gap at the lamp's edges alone.
"""

from __future__ import annotations

from dataclasses import replace

import mitsuba as mi
import numpy as np
import pytest

from tests.vctgi.small_scenes import area_light, camera, diffuse, load, room
from vctgi.config import preset
from vctgi.pipeline import light_volume, prepare_scene
from vctgi.scene.receivers import white_receivers
from vctgi.stages.cone_tracing.diffuse import trace_diffuse

pytestmark = pytest.mark.usefixtures("variant")

HALF_EDGE, GAP, RESOLUTION = 0.4, 0.01, 64
"""The lamp's, its distance from the ceiling (0.3 voxels), and the voxels of a level."""

LEAK_LIMIT = 0.02
"""Of the light beside the lamp. No point is nearer to the lamp's edge than d = 0.2, where the gap
lets in (GAP / d)^2, 0.25 %; without the lamp's back it was 1.1 times the light beside it."""


def test_back_of_a_lamp_hides_the_room() -> None:
    flat = mi.ScalarTransform4f().rotate([1, 0, 0], 90).scale(HALF_EDGE)
    lamp = {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f().translate([0, 1 - GAP, 0]) @ flat,
        "bsdf": diffuse(),
        "emitter": area_light(10.0),
    }
    scene = load(sensor=camera([0.0, -0.5, 0.9], [0.0, 0.2, 0.0], fov=80.0), **room(), lamp=lamp)
    config = preset("high")
    config = replace(config, clipmap=replace(config.clipmap, resolution=RESOLUTION))
    volume = light_volume(prepare_scene(scene, scene.sensors()[0], config), config).volume

    across = np.linspace(-0.2, 0.2, 9)
    behind = np.array([(x, 1.0, z) for x in across for z in across])
    beside = behind + np.array([0.0, 0.0, 0.75])
    points = np.concatenate([behind, beside])
    receivers = white_receivers(points, np.tile([0.0, -1.0, 0.0], (len(points), 1)))
    found = np.array(trace_diffuse(receivers, volume, config.diffuse, scene)).mean(axis=0)
    hidden, open_ = found[: len(behind)], found[len(behind) :]
    assert open_.min() > 0.0
    assert hidden.mean() <= LEAK_LIMIT * open_.mean()
