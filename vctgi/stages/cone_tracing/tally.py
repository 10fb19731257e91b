"""How much cones read: counts that a frame can be asked for, and that no frame pays for otherwise.

A tally is passed to what traces cones. Without one nothing is counted, and the kernels hold nothing
of it; with one, each launch is evaluated and summed.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import drjit as dr
import mitsuba as mi

from vctgi.stages.cone_tracing.march import ConeSample


@dataclass
class SampleTally:
    """Counts of one kind of cone, over all launches that were given it.

    Attributes
    ----------
    cone_count
        Cones that marched: those that a real ray did not end before.
    sample_count
        Steps that they took. Each is one sample of the voxels, at one place, of two levels or one.
    ray_count
        Real rays of the near field.
    """

    cone_count: int = 0
    sample_count: int = 0
    ray_count: int = 0

    def add(self, sample: ConeSample, active: mi.Bool) -> None:
        """Count the cones of a launch.

        Parameters
        ----------
        sample
            What they gathered. It is evaluated here, so that the march does not run twice.
        active
            Lanes that marched; the steps of the others are not counted.
        """
        dr.eval(sample.radiance, sample.transmittance, sample.step_count)
        self.cone_count += _count(active, dr.width(sample.step_count))
        self.sample_count += _total(mi.UInt32(dr.select(active, sample.step_count, 0)))

    def add_rays(self, active: mi.Bool, width: int) -> None:
        """Count the real rays of a launch.

        Parameters
        ----------
        active
            Lanes that traced one.
        width
            Number of lanes, of which `active` may be one value for all.
        """
        self.ray_count += _count(active, width)


@dataclass
class FrameTally:
    """Counts of a frame, by kind of cone.

    Attributes
    ----------
    gathering
        Diffuse cones; in the mode "ambient", those of ambient occlusion.
    specular
        Specular cones, and those straight through what lets light pass.
    """

    gathering: SampleTally = field(default_factory=SampleTally)
    specular: SampleTally = field(default_factory=SampleTally)


def _count(active: mi.Bool, width: int) -> int:
    """Return how many of so many lanes are active."""
    return _total(mi.UInt32(dr.select(active, dr.full(mi.UInt32, 1, width), 0)))


def _total(values: mi.UInt32) -> int:
    """Return a sum that may exceed 32 bits."""
    return int(dr.sum(mi.UInt64(values))[0])
