"""Hundreds of lamps: the time of their maps, and that none of their power is lost."""

from __future__ import annotations

import math
import time
from functools import partial

import drjit as dr
import mitsuba as mi
import numpy as np

from experiments.studies.check import Check, Measured, StudyContext, mean_of
from experiments.studies.light.emitters import room_walls, window
from vctgi.scene.lights import list_lights
from vctgi.stages.reflective_shadow_map import (
    ReflectiveShadowMapConfig,
    render_reflective_shadow_maps,
)

LAMP_COUNT = 300
MOST_SECONDS = 1.0
POWER_WITHIN = 1e-5
INTENSITY = 0.01
REPETITIONS = (10, 4)
"""Frames, in the whole study and in the quick one; one more that compiles is left out."""


def checks() -> list[Check]:
    """Return the checks on many lamps."""
    scene = f"{LAMP_COUNT} point lights in a closed room"
    return [
        Check(
            name=f"{LAMP_COUNT} point lights, seconds for their map",
            configuration="default maps, one launch",
            scene=scene,
            measure=_seconds,
            limit_high=MOST_SECONDS,
        ),
        Check(
            name=f"{LAMP_COUNT} point lights, map power",
            configuration="default maps, over closed form",
            scene=scene,
            measure=_power,
            limit_low=1.0 - POWER_WITHIN,
            limit_high=1.0 + POWER_WITHIN,
            goal=1.0,
        ),
    ]


def _measured(context: StudyContext) -> tuple[list[float], float]:
    return context.once("light, lamps", partial(_light_room, context))


def _light_room(context: StudyContext) -> tuple[list[float], float]:
    """Seconds of each frame, and power of the map over that of the lamps."""
    places = np.random.default_rng(1).uniform(-0.9, 0.9, (LAMP_COUNT, 3))
    bulbs = {
        f"bulb{number}": {
            "type": "point",
            "position": place.tolist(),
            "intensity": {"type": "rgb", "value": INTENSITY},
        }
        for number, place in enumerate(places)
    }
    scene: mi.Scene = mi.load_dict({"type": "scene", **bulbs, **room_walls()})
    lights, layout = list_lights(scene), window()
    times, power = [], 0.0
    for number in range(REPETITIONS[context.quick] + 1):
        context.progress("lamps", number / REPETITIONS[context.quick])
        begin = time.perf_counter()
        (found,) = render_reflective_shadow_maps(scene, lights, layout, ReflectiveShadowMapConfig())
        dr.sync_thread()
        times.append(time.perf_counter() - begin)
        power = float(np.array(found.incident_flux.y, dtype=np.float64).sum())
    return times[1:], power / (LAMP_COUNT * 4.0 * math.pi * INTENSITY)


def _seconds(context: StudyContext) -> Measured:
    return mean_of(_measured(context)[0])


def _power(context: StudyContext) -> Measured:
    return Measured(value=_measured(context)[1])
