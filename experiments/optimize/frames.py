"""Frames of a view at many places of the voxels' lattice, with derivatives.

Frame number n of a view has a place in the lattice of its own, n-th of an evenly spread sequence,
and random numbers of its own, so that the ripple of one place and the noise of one frame are known
from their scatter. Parameters of cones go into kernels as arrays: another value compiles nothing.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import drjit as dr
import mitsuba as mi
import numpy as np

import vctgi
from experiments.optimize.parameters import Parameter, write_point
from experiments.optimize.statistics import FILTERING_WORK, FrameCost
from experiments.optimize.target import Array
from experiments.optimize.views import View, load_view, move_scene
from experiments.studies.phases import phase_offsets
from vctgi.clipmap.storage import VoxelVolume
from vctgi.config import RenderConfig
from vctgi.pipeline import FrameTally, PreparedScene
from vctgi.stages.cone_tracing.cone_values import MARCH_NAMES
from vctgi.stages.cone_tracing.diffuse_config import DiffuseConesConfig
from vctgi.stages.reconstruction.config import ReconstructionConfig

Derivatives = Literal["forward", "differences"]
"""How derivatives are found: by Dr.Jit's forward mode, or by central differences."""

DIFFERENCE_STEP = 0.02
"""Step of central differences, inner units: 2 % of a positive parameter. Pictures ripple in their
parameters on a scale of some 0.1 %; over this step the trend is larger."""

TANGENT_STEP = 1e-4
"""Step, inner units, by which it is found how a parameter moves the cones' numbers, in double
precision."""

REPEAT_DISTANCE = 1000
"""From the seed of a frame to that of its repeat: more than there are frames."""

VOXEL_BYTES = 96
"""Upper bound for a lit voxel in storage: six directions of four floats."""

KEPT_BYTES = {"llvm": 8 << 30, "cuda": 40 << 30}
"""Most memory for lit volumes that are kept, one for each view and place; others are made anew."""


@dataclass(frozen=True)
class Picture:
    """A frame's indirect diffuse light [y, x, rgb], and what its cones read."""

    image: Array
    cost: FrameCost


class FrameSource:
    """Renders frames of views, and keeps the voxels that they have in common.

    Parameters
    ----------
    seed
        Start of the frames' random numbers.
    derivatives
        How they are found.
    """

    def __init__(self, seed: int, derivatives: Derivatives) -> None:
        self.seed = seed
        self.derivatives = derivatives
        self._volumes: OrderedDict[tuple[str, int, str], tuple[PreparedScene, VoxelVolume]] = (
            OrderedDict()
        )

    def picture(self, view: View, number: int, config: RenderConfig, *, repeat: int = 0) -> Picture:
        """Render one frame of a view; each repeat has random numbers of its own."""
        prepared, volume = self._lit(view, number, config)
        tally = FrameTally()
        frame = vctgi.render_frame(
            prepared,
            volume,
            config,
            seed=self._frame_seed(number) + REPEAT_DISTANCE * repeat,
            tally=tally,
            parameters=_live(config),
        )
        image = np.array(frame.indirect_diffuse, dtype=np.float64)
        pixels = image.shape[0] * image.shape[1]
        of_one = FILTERING_WORK[config.diffuse.march.filtering]
        cost = FrameCost(
            samples=of_one * tally.gathering.sample_count / pixels,
            rays=tally.gathering.ray_count / pixels,
        )
        return Picture(image=image, cost=cost)

    def gather(self, view: View, number: int, config: RenderConfig) -> None:
        """Render one frame as a user gets it, without arrays or counting, and wait for it."""
        prepared, volume = self._lit(view, number, config)
        vctgi.render_frame(prepared, volume, config, seed=self._frame_seed(number))
        dr.sync_thread()

    def columns(
        self, view: View, number: int, config: RenderConfig, parameters: Sequence[Parameter]
    ) -> tuple[Array, Array]:
        """Return derivatives of a frame by inner parameters.

        Returns
        -------
        tuple
            Of the picture, [parameter, y, x, rgb], and of samples and rays for each pixel,
            [2, parameter]. Those are counts, so they always come from differences.
        """
        image_columns, cost_columns = [], []
        tangents = self._tangents(config, parameters)
        live = self._forward(view, number, config, tangents)
        for place, parameter in enumerate(parameters):
            by_differences, cost = self._difference(view, number, config, parameter)
            forward = live[place]
            image_columns.append(by_differences if forward is None else forward)
            cost_columns.append(cost)
        return np.stack(image_columns), np.array(cost_columns).T

    def _difference(
        self, view: View, number: int, config: RenderConfig, parameter: Parameter
    ) -> tuple[Array, list[float]]:
        """Return the central difference of a picture and of its cost, inside the bounds."""
        centre = parameter.inner(parameter.read(config))
        low, high = parameter.inner_bounds
        ends = (max(centre - DIFFERENCE_STEP, low), min(centre + DIFFERENCE_STEP, high))
        before, after = (
            self.picture(view, number, parameter.write(config, parameter.outer(end)))
            for end in ends
        )
        length = ends[1] - ends[0]
        costs = (
            (after.cost.samples - before.cost.samples) / length,
            (after.cost.rays - before.cost.rays) / length,
        )
        return (after.image - before.image) / length, list(costs)

    def _tangents(
        self, config: RenderConfig, parameters: Sequence[Parameter]
    ) -> list[dict[str, Array]]:
        """Return how each parameter moves the arrays of the cones; empty where it moves none."""
        if self.derivatives == "differences" or not _has_live(config):
            return [{} for _ in parameters]
        return [tangents_of(config, parameter) for parameter in parameters]

    def _forward(
        self, view: View, number: int, config: RenderConfig, tangents: list[dict[str, Array]]
    ) -> list[Array | None]:
        """Return derivatives of a picture in forward mode, one pass for each parameter."""
        found: list[Array | None] = []
        for tangent in tangents:
            if not tangent:
                found.append(None)
                continue
            prepared, volume = self._lit(view, number, config)
            live = _live(config)
            assert live is not None
            for name in tangent:
                dr.enable_grad(live[name])
            frame = vctgi.render_frame(
                prepared, volume, config, seed=self._frame_seed(number), parameters=live
            )
            for name, values in tangent.items():
                dr.set_grad(live[name], mi.Float(values.tolist()))
                dr.enqueue(dr.ADMode.Forward, live[name])
            dr.traverse(dr.ADMode.Forward)
            image = np.array(dr.grad(frame.indirect_diffuse), dtype=np.float64)
            found.append(image.reshape(np.shape(frame.indirect_diffuse)))
        return found

    def _frame_seed(self, number: int) -> int:
        return self.seed + 1 + number

    def _lit(
        self, view: View, number: int, config: RenderConfig
    ) -> tuple[PreparedScene, VoxelVolume]:
        """Return a scene at the frame's place in the lattice, with lit voxels."""
        # Derivatives of cones go through numbers, not through a texture unit.
        storage = config.storage
        if storage.format in ("auto", "texture16"):
            config = replace(config, storage=replace(storage, format="float32"))
        key = (view.key, number, lighting_key(config))
        if key in self._volumes:
            self._volumes.move_to_end(key)
            return self._volumes[key]
        loaded = load_view(view.name, view.options)
        sensor = loaded.scene.sensors()[loaded.sensor_index]
        layout = vctgi.prepare_scene(loaded.scene, sensor, config).plan.layout
        offset = phase_offsets(number + 1)[number] * layout.coarsest.voxel_size
        move_scene(loaded.scene, offset, view.name.title)
        prepared = vctgi.prepare_scene(loaded.scene, sensor, config)
        lit = vctgi.light_volume(prepared, config)
        self._volumes[key] = (prepared, lit.volume)
        while len(self._volumes) > 1 and self._kept_bytes() > KEPT_BYTES[_backend()]:
            self._volumes.popitem(last=False)
        return self._volumes[key]

    def _kept_bytes(self) -> int:
        """Return the memory of the volumes that are kept."""
        return sum(VOXEL_BYTES * volume.layout.voxel_count for _, volume in self._volumes.values())


def tangents_of(config: RenderConfig, parameter: Parameter) -> dict[str, Array]:
    """Return derivatives of the arrays of `ConeParameters` by an inner parameter, by name.

    From differences in double precision, of numbers that hardly bend; an array that does not move
    is left out.
    """
    centre = parameter.inner(parameter.read(config))
    low, high = parameter.inner_bounds
    ends = (max(centre - TANGENT_STEP, low), min(centre + TANGENT_STEP, high))
    before, after = (live_numbers(parameter.write(config, parameter.outer(end))) for end in ends)
    length = ends[1] - ends[0]
    found = {name: (after[name] - before[name]) / length for name in before}
    return {name: values for name, values in found.items() if np.any(values != 0.0)}


def live_numbers(config: RenderConfig) -> dict[str, Array]:
    """Return what `ConeParameters.from_config` holds of the diffuse cones, in double precision."""
    diffuse = config.diffuse
    cones = diffuse.cones()
    return {
        "apertures": np.array(cones.apertures) / diffuse.aperture_scale,
        "weights": np.array(cones.weights),
        "elevations": np.arccos(np.minimum(1.0, [z for _, _, z in cones.directions])),
        "aperture_scale": np.array([diffuse.aperture_scale]),
        **{
            name: np.array([getattr(diffuse.march, held)], dtype=np.float64)
            for name, held in MARCH_NAMES.items()
        },
    }


def lighting_key(config: RenderConfig) -> str:
    """Return what the lit voxels depend on: all but how a frame gathers."""
    return repr(
        replace(
            config,
            diffuse=DiffuseConesConfig(),
            reconstruction=ReconstructionConfig(),
            samples_per_pixel=1,
        )
    )


def point_config(
    config: RenderConfig, parameters: Sequence[Parameter], point: Array
) -> RenderConfig:
    """Return the configuration of an inner point."""
    values = [each.outer(float(x)) for each, x in zip(parameters, point, strict=True)]
    return write_point(config, parameters, values)


def _backend() -> str:
    """Return the back end's name as it begins that of the variant."""
    variant = mi.variant()
    assert variant is not None, "a variant is set before anything is rendered"
    return variant.partition("_")[0]


def _has_live(config: RenderConfig) -> bool:
    """Whether the cones' numbers can be arrays: those of cones that belong to a surface."""
    return config.diffuse.cones().frame == "tangent"


def _live(config: RenderConfig) -> vctgi.ConeParameters | None:
    return vctgi.ConeParameters.from_config(config) if _has_live(config) else None
