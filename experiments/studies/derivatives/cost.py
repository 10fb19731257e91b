"""What a derivative costs: time and memory against a plain picture, and against its steps."""

from __future__ import annotations

import gc
import time

import drjit as dr
import mitsuba as mi

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.derivatives.measure import Picture
from experiments.studies.derivatives.room import DerivativeRoom, derivative_room

REPETITIONS = 5
"""Timed pictures, of which the fastest counts; one more compiles."""

SHORTEST = (0.25, 0.05)
"""Shortest steps, voxels: the second takes about five times the steps of the first."""


def checks(scene: str) -> list[Check]:
    """Return the checks of what derivatives cost."""
    return [
        Check(
            name="gradient by all cone apertures, reverse mode, time over a picture's",
            configuration="picture and backward pass over a picture; machine-dependent",
            scene=scene,
            measure=_time_share,
            goal=4.0,
        ),
        Check(
            name="gradient by all cone apertures, peak memory over a picture's",
            configuration="picture and backward pass over a picture, arrays of Dr.Jit",
            scene=scene,
            measure=_memory_share,
            goal=4.0,
        ),
        Check(
            name="backward pass, peak memory with five times the steps",
            configuration=f"shortest step {SHORTEST[1]} over {SHORTEST[0]} voxels",
            scene=scene,
            measure=_memory_of_steps,
            limit_high=1.01,
            goal=1.0,
        ),
    ]


def _gradient(picture: Picture, room: DerivativeRoom) -> None:
    values = mi.Float(room.cones()["apertures"])
    dr.enable_grad(values)
    dr.backward(picture(values))
    dr.eval(dr.grad(values))
    dr.sync_thread()


def _plain(picture: Picture, room: DerivativeRoom) -> None:
    dr.eval(picture(mi.Float(room.cones()["apertures"])))
    dr.sync_thread()


def _time_share(context: StudyContext) -> Measured:
    room = derivative_room(context)
    picture = room.with_cones("apertures")
    fastest = []
    for render in (_plain, _gradient):
        render(picture, room)
        seconds = []
        for _ in range(REPETITIONS):
            begin = time.perf_counter()
            render(picture, room)
            seconds.append(time.perf_counter() - begin)
        fastest.append(min(seconds))
    return Measured(value=fastest[1] / fastest[0])


def _peak(room: DerivativeRoom, shortest: float | None, *, is_plain: bool = False) -> int:
    """Bytes of Dr.Jit's arrays at their peak while a picture and its gradient are made."""
    step = room.cones()["min_step_voxels"] if shortest is None else dr.opaque(mi.Float, shortest)
    ratio = room.cones()["step_ratio"] if shortest is None else dr.opaque(mi.Float, 0.5 * shortest)

    def picture(values: mi.Float) -> mi.Float:
        numbers = {"apertures": values, "min_step_voxels": step, "step_ratio": ratio}
        return room.numbers(numbers)

    gc.collect()
    dr.flush_malloc_cache()
    dr.detail.malloc_clear_statistics()
    (_plain if is_plain else _gradient)(picture, room)
    return int(dr.detail.malloc_watermark(dr.backend_v(mi.Float)))


def _memory_share(context: StudyContext) -> Measured:
    room = derivative_room(context)
    return Measured(value=_peak(room, None) / _peak(room, None, is_plain=True))


def _memory_of_steps(context: StudyContext) -> Measured:
    room = derivative_room(context)
    few, many = (_peak(room, shortest) for shortest in SHORTEST)
    return Measured(value=many / few)
