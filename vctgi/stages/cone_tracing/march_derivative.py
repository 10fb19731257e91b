"""The march as one operation of Dr.Jit's automatic differentiation, and what may go through it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.formats import FloatCode
from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.storage import VoxelVolume
from vctgi.stages.cone_tracing.live_march import AnyMarch, LiveMarch
from vctgi.stages.cone_tracing.march_loop import ConeSample, run_march
from vctgi.stages.cone_tracing.march_replay import (
    NUMBERS,
    MarchInputs,
    march_backward,
    march_forward,
)
from vctgi.stages.cone_tracing.march_step import ConeRay

if TYPE_CHECKING:
    from typing import TypeAlias

    Lanes: TypeAlias = dict[str, mi.Float]


def has_derivatives(
    volume: VoxelVolume, cone: ConeRay, t: mi.Float, phase: mi.Float, config: AnyMarch
) -> bool:
    """Whether anything that a march depends on has derivatives."""
    numbers = []
    if isinstance(config, LiveMarch):
        numbers = [getattr(config, name) for name in NUMBERS]
    lanes = [cone.apex, cone.axis, cone.ratio, cone.t_end, t, phase, *numbers]
    return _words_have_derivatives(volume) or bool(dr.grad_enabled(lanes))


def differentiated_march(
    volume: VoxelVolume,
    cone: ConeRay,
    t: mi.Float,
    phase: mi.Float,
    active: mi.Bool,
    config: AnyMarch,
) -> ConeSample:
    """March as `run_march` does, with derivatives in both modes.

    Raises
    ------
    ValueError
        The voxels are in a format that derivatives cannot go through.
    """
    lanes = _lanes(cone, t, phase, config)
    words = None
    if _words_have_derivatives(volume):
        words = volume.texels.words  # type: ignore[attr-defined]
    elif not isinstance(volume.texels, GatheredTexels):
        raise ValueError(
            'march_cone: the format "texture16" has no derivatives, its weights are those of '
            'the texture unit; light voxels of the format "auto" with `parameters`, too, or '
            'set StorageConfig.format to "float32".'
        )
    wanted = [name for name, value in lanes.items() if dr.grad_enabled(value)]
    march = MarchInputs(volume, dr.detach(active), config, wanted)
    radiance, transmittance, step_count = dr.custom(_MarchOperation, lanes, words, march)
    return ConeSample(radiance, transmittance, step_count)


def _words_have_derivatives(volume: VoxelVolume) -> bool:
    texels = volume.texels
    if not isinstance(texels, GatheredTexels):
        return False
    if not dr.grad_enabled(texels.words):
        return False
    if texels.code != FloatCode(is_half=False):
        raise ValueError(
            'march_cone: only voxels of the format "float32" have derivatives of their own; '
            "set StorageConfig.format to it, or detach the voxels."
        )
    return True


def _lanes(cone: ConeRay, t: mi.Float, phase: mi.Float, config: AnyMarch) -> Lanes:
    """Return every number of a march, one a lane, by name."""
    lanes = {f"apex.{axis}": mi.Float(cone.apex[axis]) for axis in range(3)}
    lanes |= {f"axis.{axis}": mi.Float(cone.axis[axis]) for axis in range(3)}
    lanes |= {"ratio": mi.Float(cone.ratio), "t_end": cone.t_end, "phase": phase, "t": t}
    if isinstance(config, LiveMarch):
        for name in NUMBERS:
            value = getattr(config, name)
            if value is not None:
                lanes[name] = mi.Float(value)
    # A number that is one for all lanes would have one derivative for all of them in the loop.
    full = dr.zeros(mi.Float, dr.width(t))
    return {name: value + full for name, value in lanes.items()}


class _MarchOperation(dr.CustomOp):
    """The march as one operation of Dr.Jit's automatic differentiation."""

    def eval(
        self, lanes: Lanes, words: mi.Float | None, march: MarchInputs
    ) -> tuple[mi.Color3f, mi.Float, mi.UInt32]:
        self.lanes, self.words, self.march = lanes, words, march
        found = run_march(
            march.voxels(words),
            march.cone(lanes),
            lanes["t"],
            lanes["phase"],
            march.active,
            march.rules(lanes),
        )
        dr.eval(found.radiance, found.transmittance, found.step_count)
        # Without ties to the results that are handed out, which would keep this operation alive.
        radiance = mi.Color3f(*(mi.Float(channel) for channel in found.radiance))
        self.total = (radiance, mi.Float(found.transmittance))
        return found.radiance, found.transmittance, found.step_count

    def forward(self) -> None:
        tangents: Any = self.grad_in("lanes")
        tangents = {name: tangents[name] for name in self.march.wanted}
        words = None if self.words is None else self.grad_in("words")
        radiance, transmittance = march_forward(self.march, self.lanes, self.words, tangents, words)
        self.set_grad_out((radiance, transmittance, mi.UInt32(0)))

    def backward(self) -> None:
        adjoint: Any = self.grad_out()
        found, words = march_backward(self.march, self.lanes, self.words, self.total, adjoint[:2])
        zero = dr.zeros(mi.Float, dr.width(self.lanes["t"]))
        self.set_grad_in("lanes", {name: found.get(name, zero) for name in self.lanes})
        if words is not None:
            self.set_grad_in("words", words)
            # The sum over marches, or all of its parts would be kept until the last.
            dr.eval(self.grad_in("words"))

    def name(self) -> str:
        return "march_cone"
