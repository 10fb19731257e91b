"""Study "flicker": its list of checks, and motion vectors of a real camera."""

from __future__ import annotations

from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import vctgi
from experiments.scenes.cornell_box import cornell_box
from experiments.studies.catalogue import checks_of, find_study
from experiments.studies.flicker.sequences import move_sensor, places_before
from experiments.studies.flicker.surfaces import SEVERAL, surfaces_shown
from metrics.flicker import changes, motion_of
from vctgi.stages.reconstruction.temporal import project

pytestmark = pytest.mark.usefixtures("variant")

EDGE = 64

RESAMPLED = 2e-3
"""World units, in a room two wide: positions at random places of their pixels, in the mean."""


def test_every_check_has_a_name_of_its_own_and_says_with_what() -> None:
    found = checks_of(find_study("flicker"))
    assert len({check.name for check in found}) == len(found)
    assert all(check.configuration and check.scene for check in found)


def test_motion_vectors_lead_to_the_same_point() -> None:
    description: dict[str, Any] = cornell_box()
    description["sensor"]["film"].update(width=EDGE, height=EDGE)
    scene: mi.Scene = mi.load_dict(description)
    sensor = scene.sensors()[0]
    start = np.array(sensor.world_transform().matrix, dtype=np.float64).reshape(4, 4)
    config = vctgi.RenderConfig(samples_per_pixel=1)
    prepared = vctgi.prepare_scene(scene, sensor, config)
    volume = vctgi.light_volume(prepared, config).volume
    positions, normals, places = [], [], []
    for number in range(2):
        move_sensor(sensor, start, number * np.array([0.03, 0.02, 0.0]))
        frame = vctgi.render_frame(prepared, volume, config)
        positions.append(np.array(frame.position, dtype=np.float64))
        normals.append(np.array(frame.surface_normal, dtype=np.float64))
        if number == 0:
            before = project(sensor)
    places.append(places_before(before, positions[1]))
    motion = motion_of(np.stack(places), np.stack(positions), np.stack(normals))
    assert motion.is_followed.mean() > 0.4
    # A point does not move, whoever looks: its position is the light that must not flicker.
    moved = changes(np.stack(positions), motion)
    assert abs(moved.mean()) < RESAMPLED


def test_a_lamp_is_none_of_the_ceiling_that_it_hangs_under() -> None:
    description: dict[str, Any] = cornell_box()
    description["sensor"]["film"].update(width=EDGE, height=EDGE)
    scene: mi.Scene = mi.load_dict(description)
    shown = surfaces_shown(scene, scene.sensors()[0])
    # Between surfaces lie pixels that show several; Mitsuba merges shapes that share a material.
    assert 0.05 < (shown == SEVERAL).mean() < 0.3
    # The lamp lies in the ceiling's plane but for a hundredth of the room.
    upper = shown[: EDGE // 2, EDGE // 2]
    assert len(set(upper[upper != SEVERAL].tolist())) == 2
    assert (upper == SEVERAL).any()
