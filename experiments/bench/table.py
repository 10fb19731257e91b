"""A benchmark as lines of text."""

from __future__ import annotations

from collections.abc import Iterator

from reports.bench_record import BenchRecord, FrameResult, PresetResult

HEAD = (
    f"    {'stage':<18}{'median':>9}{'worst':>9}{'floor':>9}{'ratio':>8}"
    f"{'texel reads':>14}{'bytes':>15}{'launches':>10}{'operations':>12}"
)


def bench_lines(record: BenchRecord) -> Iterator[str]:
    """Yield the lines of the table; times are milliseconds."""
    machine = record.machine
    yield f"{record.scene}, {record.width}x{record.height}, {machine.device}"
    for preset in record.presets:
        yield from _preset_lines(preset)


def _preset_lines(preset: PresetResult) -> Iterator[str]:
    cones, rates = preset.cones, preset.rates
    yield ""
    yield f"{preset.preset}: {preset.configuration}"
    if preset.goal_ms is not None:
        yield (
            f"  at 1920x1080: {preset.talk_ms:g} ms on a GTX TITAN (talk), {preset.scaled_ms:g} "
            f"scaled to an H200, goal {preset.goal_ms:g}"
        )
    yield (
        f"  rates: {rates.coherent_reads:.3g} reads/s coherent, {rates.random_reads:.3g} random; "
        f"{rates.copied_bytes:.3g} bytes/s copied; volume {cones.volume_bytes / 2**20:.0f} MiB"
    )
    for name, count, samples in (
        ("diffuse or ambient", cones.gathering_cones, cones.gathering_samples),
        ("specular", cones.specular_cones, cones.specular_samples),
    ):
        if count:
            yield (
                f"  {name} cones: {count:,} marched, {samples / count:.2f} samples each, "
                f"{samples:,} in all"
            )
    if cones.rays:
        yield f"  rays of the near field: {cones.rays:,}"
    for frames in preset.frames:
        yield from _frame_lines(frames)
    for first in preset.first_frames:
        yield (
            f"  first frame, {first.cache} cache: import {first.import_s:.2f} s, "
            f"load {first.load_s:.2f}, prepare {first.prepare_s:.2f}, "
            f"frame {first.first_frame_s:.2f}, second frame {first.second_frame_s:.2f}; "
            f"{first.compiled} of {first.kernels} kernels compiled in {first.backend_s:.2f} s"
        )


def _frame_lines(frames: FrameResult) -> Iterator[str]:
    times = frames.device_ms
    yield (
        f"  {frames.kind}: {times.median:.3f} ms [{times.low:.3f}, {times.high:.3f}], worst "
        f"{times.worst:.3f} (frame {frames.worst_frame} of {frames.frame_count}); host "
        f"{frames.host_ms:.1f}, wall {frames.wall_ms:.1f}, "
        f"{'' if frames.loop_ms is None else f'in a loop {frames.loop_ms:.1f}, '}"
        f"not counted {frames.application_ms:.2f};"
        f" {frames.compiled} kernels compiled"
    )
    yield HEAD
    for each in frames.stages:
        ratio = f"{each.device_ms.median / each.floor_ms:.1f}" if each.floor_ms > 0.0 else "-"
        counts = each.counts
        yield (
            f"    {each.stage:<18}{each.device_ms.median:>9.3f}{each.device_ms.worst:>9.3f}"
            f"{each.floor_ms:>9.4f}{ratio:>8}{counts.texel_reads:>14,}{counts.bytes:>15,}"
            f"{counts.launches:>10,}{counts.operations:>12,}"
        )
