"""The rows of the study "speed": ratios of times to those of paths, and of reads to bare ones.

The preset is measured as it is, with its rays a pixel, and at one ray a pixel, as the talk has it.
Paths and denoised paths are those of the study "pareto", which also has other methods and sizes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import drjit as dr
import mitsuba as mi

import vctgi
from experiments.bench.kernels import TRACING, KernelClock
from experiments.bench.reads import counting, measure_rates
from experiments.bench.walks import STILL, Walk
from experiments.scenes import LoadedScene, load_scene
from experiments.studies.check import Check, Measured, RefusedError, StudyContext, mean_of
from experiments.studies.pareto.bench import Bench, bench_once, has_denoiser, run_methods
from experiments.studies.pareto.methods import DENOISED, OURS, PATHS, Method, path_name
from experiments.studies.pareto.rows import errors_over_time, family_of
from experiments.studies.pareto.trade_off import ratio, time_to_reach
from reports.bench_record import Rates
from reports.study_figures import Definition
from vctgi.config import RenderConfig, preset

SIZES: Final = {
    dr.JitBackend.LLVM: (480, 270),
    dr.JitBackend.CUDA: (1920, 1080),
}
QUICK_SIZE: Final = (64, 36)
"""Pictures, pixels."""

QUICK_VOXELS: Final = 32
"""Along an edge of a level in the quick study."""

PATH_COUNTS: Final = {True: (1, 8, 64, 512), False: (1, 8, 64, 512)}
"""Samples a pixel of path tracing, in the quick study and in the whole one."""

DENOISED_COUNT: Final = 4
"""Samples a pixel that are denoised."""

LEAST_TO_PATHS: Final = 10.0
LEAST_TO_DENOISED: Final = 4.0
MOST_TO_BARE: Final = 1.5
"""What is asked on two CPU cores: times of paths over those of cones, and the rate of bare reads
over that of cones'."""

CHOSEN: Final = "chosen scene"
"""The scene of `--scene`; without one, that of a corridor of rooms."""

SCENES: Final = ("cornell_box", CHOSEN)

HIGH, SINGLE = "high", "high, 1 spp"
"""The preset, and the same at one ray a pixel."""

READ_FRAMES: Final = 7
"""Frames whose reads are timed."""

DEFINITIONS = (
    Definition(
        name="paths' time to its error",
        formula="device time at which path tracing's relMSE, straight between its points in both "
        "logarithms, comes down to the cones', over that of the cones' still frame",
        source="experiments/studies/pareto/trade_off.py, time_to_reach",
    ),
    Definition(
        name="denoised paths' time",
        formula=f"device time of {DENOISED_COUNT} samples a pixel with the wall time of the "
        "denoiser, which runs on the CPU, over that of the cones' still frame",
        source="experiments/clocks.py",
    ),
    Definition(
        name="bare reads over reads of cones",
        formula="texels a second that a loop reads which does nothing else, neighbouring lanes "
        "neighbouring texels, over those that the tracing of a still frame reads",
        source="experiments/bench/reads.py, experiments/bench/kernels.py",
    ),
)

Read = Callable[[StudyContext, str], Measured]


def checks() -> list[Check]:
    """Return the checks of both scenes."""
    is_cpu = dr.backend_v(mi.Float) == dr.JitBackend.LLVM
    found = []
    for scene in SCENES:
        for method in (HIGH, SINGLE):
            found += [
                _check(scene, f"paths' time to the error of {method}, over its own",
                       partial(_over_paths, method), low=LEAST_TO_PATHS if is_cpu else None),
                _check(scene, f"time of {_denoised_name()}, over that of {method}",
                       partial(_over_denoised, method), low=LEAST_TO_DENOISED if is_cpu else None),
                _check(scene, f"relMSE of {method}", partial(_relmse, method)),
                _check(scene, f"device time of {method}, ms", partial(_time, method)),
            ]  # fmt: skip
        found += [
            _check(scene, f"relMSE of {_denoised_name()}",
                   partial(_relmse, _denoised_name())),
            _check(scene, "rate of bare reads over that of cones",
                   partial(_over_bare, "coherent_reads"), high=MOST_TO_BARE if is_cpu else None),
            _check(scene, "rate of bare reads in random order over that of cones",
                   partial(_over_bare, "random_reads")),
            _check(scene, "texels that cones read a second", _read_rate),
        ]  # fmt: skip
    return found


def _check(
    scene: str, title: str, read: Read, low: float | None = None, high: float | None = None
) -> Check:
    def measure(context: StudyContext) -> Measured:
        try:
            return read(context, (context.scene or "corridor") if scene == CHOSEN else scene)
        except ValueError as error:
            # What noise hides, or lies beyond the end of a curve.
            raise RefusedError(str(error)) from error

    words = "built-in corridor, or the scene of --scene" if scene == CHOSEN else f"built-in {scene}"
    return Check(
        name=f"{scene}, {title}",
        configuration='preset "high"; still frames by the device\'s clock',
        scene=words,
        measure=measure,
        limit_low=low,
        limit_high=high,
        in_quick=scene != CHOSEN,
        is_headline=low is not None or high is not None,
    )


def _denoised_name() -> str:
    return f"denoised paths, {DENOISED_COUNT} spp"


def _config(context: StudyContext) -> RenderConfig:
    config = preset(HIGH)
    if not context.quick:
        return config
    return replace(config, clipmap=replace(config.clipmap, resolution=QUICK_VOXELS))


def _loaded(context: StudyContext, source: str) -> LoadedScene:
    size = QUICK_SIZE if context.quick else SIZES[dr.backend_v(mi.Float)]
    return load_scene(source, resolution=size)


def _race(context: StudyContext, source: str) -> Bench:
    """Return times and errors of cones, paths and denoised paths."""

    def run() -> Bench:
        config = _config(context)
        cones = [
            Method(
                name=name,
                family=OURS,
                config=each,
                samples_per_pixel=each.samples_per_pixel,
            )
            for name, each in ((HIGH, config), (SINGLE, replace(config, samples_per_pixel=1)))
        ]
        paths = [
            Method(name=path_name(count), family=PATHS, samples_per_pixel=count)
            for count in PATH_COUNTS[context.quick]
        ]
        paths.append(
            Method(name=_denoised_name(), family=DENOISED, samples_per_pixel=DENOISED_COUNT)
        )
        return run_methods(context, _loaded(context, source), cones, paths, has_moving=False)

    return bench_once(context, f"speed: race of {source}", run)


def _over_paths(method: str, context: StudyContext, source: str) -> Measured:
    bench = _race(context, source)
    own, paths = bench.results[method], family_of(bench, PATHS)
    crossing = time_to_reach(errors_over_time(paths), own.score.relmse)
    time = own.clocks[STILL].device_median()
    if crossing.reached == "inside":
        return ratio(crossing.time, time)
    counts = [each.method.samples_per_pixel for each in paths]
    note = (
        f"at most: reached with {counts[0]} sample a pixel already"
        if crossing.reached == "before"
        else f"at least: not reached within {counts[-1]} samples a pixel"
    )
    return Measured(value=crossing.time.value / time.value, note=note)


def _over_denoised(method: str, context: StudyContext, source: str) -> Measured:
    if not has_denoiser():
        raise RefusedError("nothing denoises: install the extra [denoise]")
    results = _race(context, source).results
    times = (results[each].clocks[STILL].device_median() for each in (_denoised_name(), method))
    denoised, own = times
    return ratio(denoised, own)


def _relmse(method: str, context: StudyContext, source: str) -> Measured:
    results = _race(context, source).results
    if method not in results:
        raise RefusedError("nothing denoises: install the extra [denoise]")
    return results[method].score.relmse


def _time(method: str, context: StudyContext, source: str) -> Measured:
    found = _race(context, source).results[method].clocks[STILL].device_median()
    assert found.low is not None
    assert found.high is not None
    return Measured(value=1e3 * found.value, low=1e3 * found.low, high=1e3 * found.high)


@dataclass(frozen=True)
class _Reads:
    """How fast cones read, by frame, and bare loops."""

    cones: list[float]
    bare: Rates


def _reads(context: StudyContext, source: str) -> _Reads:
    def measure() -> _Reads:
        config = replace(_config(context), samples_per_pixel=1)
        loaded = _loaded(context, source)
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        walk = Walk(vctgi.prepare_scene(loaded.scene, sensor, config), config, STILL)
        volume, take_count = counting(walk.volume)
        counted = KernelClock(take_count)
        with counted.watched() as reads:
            walk.count(volume, counted)
        clock = KernelClock()
        rates = []
        for _ in range(1 + READ_FRAMES):
            with clock.watched() as work:
                walk.frame(0, clock)
            rates.append(reads[TRACING].reads / work[TRACING].device)
        return _Reads(rates[1:], measure_rates(walk.volume))

    return context.once(f"speed: reads of {source}", measure)


def _over_bare(order: str, context: StudyContext, source: str) -> Measured:
    found = _reads(context, source)
    bare = float(getattr(found.bare, order))
    return mean_of([bare / each for each in found.cones])


def _read_rate(context: StudyContext, source: str) -> Measured:
    return mean_of(_reads(context, source).cones)
