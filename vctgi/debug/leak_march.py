"""A march that knows which of its light came through geometry.

It takes the steps of `vctgi.stages.cone_tracing.march.march_cone` and returns the same radiance. At
each step it asks what share of the cone truly reaches that far, by probe rays traced beforehand,
and compares it with the transmittance that the voxels left. It also keeps one step, chosen with a
probability in proportion to the light that the step added, so that a single shadow ray can judge
the cone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.directions import random_unit
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.cone_tracing.march import (
    ConeMarchConfig,
    finest_level,
    level_read,
    limited_end,
    march_range,
    step_at,
)
from vctgi.stages.cone_tracing.step_rules import step_length

REACH_VOXELS = math.sqrt(3.0)
"""How far behind a surface its light may be read, in voxels of the level that is read: the diagonal
of a voxel, within which the voxels of the surface itself reach."""


@dataclass
class LeakSample:
    """What a cone gathered, and how it came.

    Attributes
    ----------
    radiance, transmittance
        As of `march_cone`.
    through
        Part of the radiance for which the voxels let more pass than the geometry does: of a step
        with transmittance T, of whose cone the share V truly reaches it, max(0, 1 - V / T).
    hidden
        The part read where no probe reaches: at least this much came through geometry.
    blocked
        The part read where a probe, taken at random, does not reach: at most this much did. It also
        holds light that was dimmed rightly by what covers a part of the cone.
    chosen_t
        Distance of the chosen step, world units; 0 where the cone saw nothing.
    chosen_reach
        How far behind a surface light may be read there, world units.
    """

    radiance: mi.Color3f
    transmittance: mi.Float
    through: mi.Color3f
    hidden: mi.Color3f
    blocked: mi.Color3f
    chosen_t: mi.Float
    chosen_reach: mi.Float


@dataclass
class Cones:
    """Cones to march.

    Attributes
    ----------
    apex, axis
        World points where they start, and unit directions.
    ratio
        Footprint over distance.
    phase
        Share of the first step that is taken, (0, 1].
    t_near
        Distance before which real rays see to them, world units.
    """

    apex: mi.Point3f
    axis: mi.Vector3f
    ratio: mi.Float
    phase: mi.Float
    t_near: mi.Float


@dataclass
class Probes:
    """How far cones truly reach.

    Attributes
    ----------
    distance
        For each probe where it is stopped, measured along the cone's axis; infinite if it is not.
    share
        For each probe its share in the cone; a cone's shares sum to 1.
    """

    distance: Sequence[mi.Float]
    share: Sequence[mi.Float]

    def reaching(self, t: mi.Float) -> mi.Float:
        """Return the share of the cone that geometry lets through to a distance."""
        total = mi.Float(0.0)
        for distance, share in zip(self.distance, self.share, strict=True):
            total += dr.select(distance >= t, share, 0.0)
        return total


@dataclass
class _State:
    t: mi.Float
    step_share: mi.Float
    transmittance: mi.Float
    radiance: mi.Color3f
    through: mi.Color3f
    hidden: mi.Color3f
    blocked: mi.Color3f
    chosen_t: mi.Float
    chosen_reach: mi.Float
    number: mi.UInt32


def march_with_probes(
    volume: VoxelVolume,
    cones: Cones,
    probes: Probes,
    config: ConeMarchConfig,
    active: mi.Bool,
    seed: int,
) -> LeakSample:
    """March one cone per lane and say what of its light came through geometry.

    Parameters
    ----------
    volume
        Opacity and emittance to march through.
    cones
        The cones.
    probes
        What geometry each of them meets.
    config
        Step, offset and level rules; without a falloff, which is no light.
    active
        Lanes that march.
    seed
        Of the choice of a step.

    Raises
    ------
    ValueError
        The march has a falloff.
    """
    if config.falloff_length is not None:
        raise ValueError(
            "march_with_probes: ConeMarchConfig.falloff_length gathers no light; set it to None."
        )
    layout = volume.layout
    apex, axis, cone_ratio = cones.apex, cones.axis, cones.ratio
    width = max(dr.width(apex), dr.width(axis))
    full = dr.zeros(mi.Float, width)
    t_begin, t_end = march_range(volume, apex, axis, cone_ratio)
    t_end = limited_end(layout, t_end, cone_ratio, config)
    start = config.start_offset_voxels * layout.finest_voxel_size
    t_start = dr.maximum(start * dr.exp2(finest_level(volume, apex)), cones.t_near)
    lane = dr.arange(mi.UInt32, width)
    stream = dr.opaque(mi.UInt32, CHOICE_STREAM + seed * STREAM_STRIDE)
    next_float: float = 1.0 + dr.epsilon(mi.Float)  # type: ignore[no-untyped-call]

    def is_running(s: _State) -> mi.Bool:
        return active & (s.t < t_end) & (s.transmittance > config.min_transmittance)

    def advance(s: _State) -> tuple[_State]:
        # The step of `march_cone`, to the letter.
        p_begin = mi.Point3f(dr.fma(axis, s.t, apex))
        held = layout.finest_voxel_size * dr.exp2(finest_level(volume, p_begin))
        step = step_length(s.t, held, cone_ratio, config)
        step = dr.minimum(step * s.step_share, t_end - s.t)
        t_read = dr.fma(config.sample_place, step, s.t)
        p_read = mi.Point3f(dr.fma(axis, t_read, apex))
        stopped, seen = step_at(volume, p_read, axis, cone_ratio * t_read, step, config)
        light = mi.Color3f(as_component(s.transmittance) * seen)

        # Light of a surface fills the voxels around it.
        level = level_read(volume, p_read, cone_ratio * t_read, config)
        reach = REACH_VOXELS * layout.finest_voxel_size * dr.exp2(level)
        visible = probes.reaching(t_read - reach)
        share = dr.maximum(1.0 - visible / s.transmittance, 0.0)
        is_hidden = visible <= 0.0

        # One step is kept: the newest in proportion to its light among all so far.
        radiance = mi.Color3f(dr.fma(as_component(s.transmittance), seen, s.radiance))
        u = random_unit(lane, stream + s.number)
        is_chosen = u * mi.Float(mi.luminance(radiance)) < mi.Float(mi.luminance(light))
        return (
            _State(
                t=dr.maximum(s.t + step, s.t * next_float),
                step_share=full + 1.0,
                transmittance=s.transmittance * (1.0 - stopped),
                radiance=radiance,
                through=mi.Color3f(s.through + light * as_component(share)),
                hidden=mi.Color3f(s.hidden + dr.select(is_hidden, light, 0.0)),
                blocked=mi.Color3f(s.blocked + light * as_component(1.0 - visible)),
                chosen_t=dr.select(is_chosen, t_read, s.chosen_t),
                chosen_reach=dr.select(is_chosen, reach, s.chosen_reach),
                number=s.number + 1,
            ),
        )

    begin = _State(
        t=dr.maximum(t_begin, t_start) + full,
        step_share=cones.phase + full,
        transmittance=full + 1.0,
        radiance=mi.Color3f(full, full, full),
        through=mi.Color3f(full, full, full),
        hidden=mi.Color3f(full, full, full),
        blocked=mi.Color3f(full, full, full),
        chosen_t=full + 0.0,
        chosen_reach=full + 0.0,
        number=dr.zeros(mi.UInt32, width),
    )
    (end,) = dr.while_loop(state=(begin,), cond=is_running, body=advance, label="leak_march")
    return LeakSample(
        end.radiance,
        end.transmittance,
        end.through,
        end.hidden,
        end.blocked,
        end.chosen_t,
        end.chosen_reach,
    )


CHOICE_STREAM = 5000
"""First hash stream of the choice of a step."""

STREAM_STRIDE = 4096
"""Streams of one seed: more than a march has steps."""
