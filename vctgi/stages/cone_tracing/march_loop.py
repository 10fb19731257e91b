"""The loop of a march: steps until the cone ends or hardly anything gets through."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.cone_tracing.live_march import AnyMarch
from vctgi.stages.cone_tracing.march_step import ConeRay, advanced, next_step, read_step


@dataclass
class ConeSample:
    """What a cone gathered.

    Attributes
    ----------
    radiance
        Mean radiance over the cone, W m^-2 sr^-1.
    transmittance
        Share of the cone that nothing stopped, [0, 1].
    step_count
        Steps taken.
    """

    radiance: mi.Color3f
    transmittance: mi.Float
    step_count: mi.UInt32


def run_march(
    volume: VoxelVolume,
    cone: ConeRay,
    t: mi.Float,
    phase: mi.Float,
    active: mi.Bool,
    config: AnyMarch,
) -> ConeSample:
    """March from a distance on; the arguments are those of `march_cone` at their full width.

    Parameters
    ----------
    t
        Where each cone's first step begins, world units.
    """
    # Every loop variable starts at its full width: a one-lane start returns wrong derivatives.
    width = dr.width(t)
    full = dr.zeros(mi.Float, width)

    def is_running(
        t: mi.Float,
        step_share: mi.Float,
        transmittance: mi.Float,
        radiance: mi.Color3f,
        step_count: mi.UInt32,
    ) -> mi.Bool:
        return active & (t < cone.t_end) & (transmittance > config.min_transmittance)

    def advance(
        t: mi.Float,
        step_share: mi.Float,
        transmittance: mi.Float,
        radiance: mi.Color3f,
        step_count: mi.UInt32,
    ) -> tuple[mi.Float, mi.Float, mi.Float, mi.Color3f, mi.UInt32]:
        step = next_step(volume, cone, t, step_share, config)
        stopped, seen = read_step(volume, cone, t, step, config)
        radiance = dr.fma(as_component(transmittance), seen, radiance)
        t = advanced(t, step)
        return t, full + 1.0, transmittance * (1.0 - stopped), radiance, step_count + 1

    _, _, transmittance, radiance, step_count = dr.while_loop(
        state=(
            t,
            phase,
            full + 1.0,
            mi.Color3f(full, full, full),
            dr.zeros(mi.UInt32, width),
        ),
        cond=is_running,
        body=advance,
        labels=("t", "step_share", "transmittance", "radiance", "step_count"),
        label="march_cone",
    )
    return ConeSample(radiance, transmittance, step_count)
