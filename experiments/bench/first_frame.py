"""From nothing to the first frame, in a process of its own.

Kernels are kept between runs by Dr.Jit, and behind it by the GPU's driver. A folder of their own
for all of them, empty at first, makes a cold start; the same folder again makes the second start.
The process is `python -m experiments.bench.first_frame`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from experiments.errors import MachineryError
from reports.bench_record import FirstFrame

CACHE_VARIABLES = {
    "DRJIT_CACHE_DIR": "drjit",
    "CUDA_CACHE_PATH": "cuda",
    "OPTIX_CACHE_PATH": "optix",
}
"""Environment variables that say where compiled kernels are kept, and a folder for each."""

LONGEST = 1800.0
"""Seconds after which a start is given up."""


def measure_first_frames(request: dict[str, Any]) -> list[FirstFrame]:
    """Start twice, without a cache of kernels and with the one that the first start left.

    Parameters
    ----------
    request
        What `render_first` takes.

    Raises
    ------
    MachineryError
        A start failed.
    """
    with TemporaryDirectory(prefix="vctgi-bench-") as folder:
        return [_start(request, Path(folder), cache) for cache in ("cold", "kept")]


def _start(request: dict[str, Any], folder: Path, cache: Literal["cold", "kept"]) -> FirstFrame:
    places = {name: str(folder / each) for name, each in CACHE_VARIABLES.items()}
    for place in places.values():
        Path(place).mkdir(exist_ok=True)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "experiments.bench.first_frame", json.dumps(request)],
            env=os.environ | places,
            capture_output=True,
            text=True,
            timeout=LONGEST,
            check=True,
        )
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        words = str(error.stderr or error).strip().splitlines()
        raise MachineryError(
            what=f"the first frame could not be rendered: {words[-1] if words else 'no message'}",
            where=f"a process of its own, {cache} cache",
            remedy="render the scene by `vctgi render`, or leave out --first-frame",
        ) from error
    return FirstFrame(cache=cache, **json.loads(done.stdout.splitlines()[-1]))


def render_first(
    scene: str, size: tuple[int, int] | None, variant: str, preset: str, clipmap: dict[str, int]
) -> dict[str, float]:
    """Import, load, render two frames, and return how long each took, seconds."""
    start = time.perf_counter()
    from experiments.session import start_mitsuba

    start_mitsuba(variant)
    import drjit as dr

    import vctgi
    from experiments.bench.measure import BenchOptions, bench_config
    from experiments.scenes import load_scene

    times = {"import_s": time.perf_counter() - start}

    def lap(name: str) -> None:
        nonlocal start
        dr.sync_thread()
        times[name] = time.perf_counter() - start
        start = time.perf_counter()

    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        start = time.perf_counter()
        loaded = load_scene(scene, resolution=size)
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        config = bench_config(vctgi.preset(preset), BenchOptions(frames=1, **clipmap))
        lap("load_s")
        prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
        lap("prepare_s")
        for number, name in enumerate(("first_frame_s", "second_frame_s")):
            lit = vctgi.light_volume(prepared, config)
            vctgi.render_frame(prepared, lit.volume, config, seed=number)
            lap(name)
        kernels = [each for each in dr.kernel_history() if "hash" in each]
    different = {each["hash"] for each in kernels}
    return times | {
        "codegen_s": sum(each["codegen_time"] for each in kernels) / 1e3,
        "backend_s": sum(each["backend_time"] for each in kernels) / 1e3,
        "kernels": len(different),
        "compiled": sum(not each["cache_hit"] for each in kernels),
    }


if __name__ == "__main__":
    given = json.loads(sys.argv[1])
    if given["size"] is not None:
        given["size"] = tuple(given["size"])
    sys.stdout.write(json.dumps(render_first(**given)) + "\n")
