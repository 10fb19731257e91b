"""What a derivative costs: time and memory against a plain picture, and against its steps."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import drjit as dr
import mitsuba as mi

from experiments.studies.check import Check, Measured, StudyContext
from experiments.studies.derivatives.measure import MODES, Picture
from experiments.studies.derivatives.room import SCENE_NAMES, DerivativeRoom, derivative_room
from vctgi.config import RenderConfig

REPETITIONS = 5
"""Timed pictures, of which the fastest counts; one more compiles."""

SAMPLES = (4, 1)
"""Rays a pixel, in the whole study and in the quick one: reverse mode keeps what all see."""

SHORTEST = (0.25, 0.05)
"""Shortest steps, voxels: the second takes about five times the steps of the first."""

MOST_SHARE = 4.0
"""A gradient is to take at most so many times what a picture takes."""

LARGEST_KERNEL = 3.0
"""What kernels of derivatives may hold, by what the picture's largest does: a march with its
derivative is about twice as much as one without."""

ALBEDO = "albedo of the walls"

WHAT = {"all cone apertures": "apertures", f"the {ALBEDO}": ALBEDO}
"""Gradients that are measured: of a frame of lit voxels, and of voxels' light and frame."""


def checks(scene: str) -> list[Check]:
    """Return the checks of what derivatives cost."""
    found = []
    for words, name in WHAT.items():
        lit = ", voxels lit anew" if name == ALBEDO else ""
        found += [
            Check(
                name=f"gradient by {words}, reverse mode, time over a picture's",
                configuration=f"picture and backward pass over a picture{lit}; machine-dependent",
                scene=scene,
                measure=partial(_time_share, name=name),
                goal=MOST_SHARE,
                in_quick=name != ALBEDO,
            ),
            Check(
                name=f"gradient by {words}, reverse mode, peak memory over a picture's",
                configuration=f"picture and backward pass over a picture{lit}, arrays of Dr.Jit",
                scene=scene,
                measure=partial(_memory_share, name=name),
                limit_high=MOST_SHARE,
                in_quick=name != ALBEDO,
            ),
        ]
    found += [
        Check(
            name=f"derivatives by the {ALBEDO}, {mode} mode, largest kernel over a picture's",
            configuration="operations of Dr.Jit, which compile in a time that goes with them, or "
            "worse",
            scene=scene,
            measure=partial(_kernel_share, mode=mode),
            limit_high=LARGEST_KERNEL,
            in_quick=False,
        )
        for mode in MODES
    ]
    return [
        *found,
        Check(
            name="backward pass, peak memory with five times the steps",
            configuration=f"shortest step {SHORTEST[1]} over {SHORTEST[0]} voxels",
            scene=scene,
            measure=_memory_of_steps,
            limit_high=1.01,
            goal=1.0,
        ),
    ]


def _config(context: StudyContext, room: DerivativeRoom) -> RenderConfig:
    return replace(room.config, samples_per_pixel=SAMPLES[int(context.quick)])


def _pictured(context: StudyContext, name: str) -> tuple[Picture, Any]:
    """Return a picture by a parameter, and its values."""
    room = derivative_room(context)
    config = _config(context, room)
    if name == ALBEDO:
        key = SCENE_NAMES[ALBEDO]
        room.restore()
        return room.with_scene(key, config), room.scene_parameters[key]
    return room.with_cones(name, config), room.cones()[name]


def _gradient(picture: Picture, start: Any) -> None:
    values = type(start)(start)
    dr.make_opaque(values)
    dr.enable_grad(values)
    dr.backward(picture(values))
    dr.eval(dr.grad(values))
    dr.sync_thread()


def _plain(picture: Picture, start: Any) -> None:
    values = type(start)(start)
    dr.make_opaque(values)
    dr.eval(picture(values))
    dr.sync_thread()


def _time_share(context: StudyContext, name: str) -> Measured:
    picture, start = _pictured(context, name)
    fastest = []
    for number, render in enumerate((_plain, _gradient)):
        context.progress(f"{name}, time", 0.5 * number)
        render(picture, start)
        seconds = []
        for _ in range(REPETITIONS):
            begin = time.perf_counter()
            render(picture, start)
            seconds.append(time.perf_counter() - begin)
        fastest.append(min(seconds))
    note = f"{1e3 * fastest[1]:.3g} ms over {1e3 * fastest[0]:.3g} ms"
    return Measured(value=fastest[1] / fastest[0], note=note)


def _peak(render: Callable[[Picture, Any], None], picture: Picture, start: Any) -> int:
    """Bytes of Dr.Jit's arrays at their peak while a picture, or its gradient, is made."""
    gc.collect()
    dr.flush_malloc_cache()
    dr.detail.malloc_clear_statistics()
    render(picture, start)
    return int(dr.detail.malloc_watermark(dr.backend_v(mi.Float)))


def _memory_share(context: StudyContext, name: str) -> Measured:
    picture, start = _pictured(context, name)
    gradient, plain = (_peak(render, picture, start) for render in (_gradient, _plain))
    note = f"{gradient / 2**20:.4g} MiB over {plain / 2**20:.4g} MiB"
    return Measured(value=gradient / plain, note=note)


def _kernel_share(context: StudyContext, mode: str) -> Measured:
    picture, start = _pictured(context, ALBEDO)
    plain = _largest_kernel(lambda: _plain(picture, start))
    largest = _largest_kernel(lambda: MODES[mode](picture, start))
    return Measured(value=largest / plain, note=f"{largest} over {plain}")


def _largest_kernel(work: Callable[[], object]) -> int:
    """Return the operations of the largest kernel that some work runs."""
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        work()
        kernels = dr.kernel_history((dr.KernelType.JIT,))
    return max(int(each["operation_count"]) for each in kernels)


def _memory_of_steps(context: StudyContext) -> Measured:
    room = derivative_room(context)
    config = _config(context, room)

    def picture(values: mi.Float, shortest: float) -> mi.Float:
        lanes = {"min_step_voxels": shortest, "step_ratio": 0.5 * shortest}
        numbers = {name: dr.opaque(mi.Float, value) for name, value in lanes.items()}
        return room.numbers({"apertures": values, **numbers}, config)

    few, many = (
        _peak(_gradient, partial(picture, shortest=shortest), room.cones()["apertures"])
        for shortest in SHORTEST
    )
    return Measured(value=many / few)
