"""Derivatives of the march by marching once more, forward, whatever the number of steps.

A cone gathers L = sum_i T_i e_i, where step i adds e_i, stops the share s_i, and T_{i+1} =
T_i (1 - s_i). Once L and the final T are known, the derivative by what step i reads is that of

    T_i e_i - s_i (L - L_i - T_i e_i) / (1 - s_i)            (and - s_i T / (1 - s_i) for T itself)

with all but e_i and s_i held: everything behind the step is as much fainter as it lets less
through. So a replay from the front needs no memory of the steps. Where a step lies depends on
earlier steps, too; the tangent of its distance by each number that the steps follow from is carried
along, and the derivative by the distance is multiplied by it.

Not seen: what a cone would have met behind the place where it let less than `min_transmittance`
through: derivatives are off by a few times that share of the light, and the light may change much
less than that. Steps that appear and disappear are
no jump: the last one ends with the cone.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import drjit as dr
import mitsuba as mi

from vctgi.clipmap.gathered import GatheredTexels
from vctgi.clipmap.storage import VoxelVolume
from vctgi.maths.stub_gaps import as_component
from vctgi.stages.cone_tracing.live_march import AnyMarch, LiveMarch
from vctgi.stages.cone_tracing.march_step import ConeRay, advanced, next_step, read_step

if TYPE_CHECKING:
    from typing import TypeAlias

    Lanes: TypeAlias = dict[str, mi.Float]


NUMBERS = tuple(field.name for field in fields(LiveMarch) if field.name != "rules")


@dataclass
class MarchInputs:
    """What a march depends on besides numbers.

    Attributes
    ----------
    volume, active, config
        As for `march_cone`.
    wanted
        Numbers that have derivatives.
    """

    volume: VoxelVolume
    active: mi.Bool
    config: AnyMarch
    wanted: list[str]

    def cone(self, lanes: Lanes) -> ConeRay:
        """Return the cones of these numbers."""
        apex, axis = ([as_component(lanes[f"{name}.{i}"]) for i in range(3)] for name in ENDS)
        return ConeRay(mi.Point3f(apex), mi.Vector3f(axis), lanes["ratio"], lanes["t_end"])

    def rules(self, lanes: Lanes) -> AnyMarch:
        """Return the march of these numbers."""
        if not isinstance(self.config, LiveMarch):
            return self.config
        numbers: dict[str, Any] = {name: lanes[name] for name in NUMBERS if name in lanes}
        return replace(self.config, **numbers)

    def voxels(self, words: mi.Float | None) -> VoxelVolume:
        """Return the voxels with these words, or as they are."""
        if words is None:
            return self.volume
        assert isinstance(self.volume.texels, GatheredTexels), "only these have words"
        return replace(self.volume, texels=replace(self.volume.texels, words=words))

    def attached(self, lanes: Lanes) -> Lanes:
        """Return the numbers anew, those with derivatives as variables of their own."""
        local = {name: mi.Float(value) for name, value in lanes.items()}
        for name in self.wanted:
            dr.enable_grad(local[name])
        return local

    def step(self, lanes: Lanes, t: mi.Float, is_first: mi.Bool) -> mi.Float:
        """Return the length of the step from a distance."""
        share = dr.select(is_first, lanes["phase"], 1.0)
        return next_step(self.volume, self.cone(lanes), t, share, self.rules(lanes))


ENDS = ("apex", "axis")


def march_forward(
    march: MarchInputs, lanes: Lanes, words: mi.Float | None, tangents: Lanes, words_tangent: Any
) -> tuple[mi.Color3f, mi.Float]:
    """Return the derivatives of radiance and transmittance along tangents of what they follow."""
    # One kernel a march: derivatives of a picture go through dozens of them at once, and what
    # leads to one is as long as the march itself.
    dr.eval(tangents, words_tangent)
    none = dr.zeros(mi.Float, dr.width(lanes["t"]))
    active, least = march.active, march.config.min_transmittance

    def is_running(t: mi.Float, through: mi.Float, *_: Any) -> mi.Bool:
        return active & (t < lanes["t_end"]) & (through > least)

    def advance(
        t: mi.Float,
        through: mi.Float,
        is_first: mi.Bool,
        dt: mi.Float,
        d_through: mi.Float,
        d_radiance: mi.Color3f,
    ) -> tuple[Any, ...]:
        with dr.resume_grad():  # type: ignore[no-untyped-call]
            local, at, held = march.attached(lanes), mi.Float(t), words
            for name in march.wanted:
                dr.set_grad(local[name], tangents[name])
            dr.enable_grad(at)
            dr.set_grad(at, dt)
            if words is not None:
                held = mi.Float(words)
                dr.enable_grad(held)
                dr.set_grad(held, words_tangent)
            step = march.step(local, at, is_first)
            stopped, seen = read_step(
                march.voxels(held), march.cone(local), at, step, march.rules(local)
            )
            t_next = advanced(at, step)
            # What is stopped lies on the way to what is seen, and keeps its derivative.
            d_stopped, d_seen, dt_next = dr.forward_to(
                stopped, seen, t_next, flags=dr.ADFlag.ClearEdges
            )
        stopped, seen, t_next = dr.detach(stopped), dr.detach(seen), dr.detach(t_next)
        d_radiance = d_radiance + as_component(d_through) * seen + as_component(through) * d_seen
        d_through = d_through * (1.0 - stopped) - through * d_stopped
        return t_next, through * (1.0 - stopped), mi.Bool(False), dt_next, d_through, d_radiance

    _, _, _, _, d_through, d_radiance = dr.while_loop(
        state=(
            mi.Float(lanes["t"]),
            none + 1.0,
            none == 0.0,
            tangents.get("t", none) + none,
            mi.Float(none),
            mi.Color3f(none, none, none),
        ),
        cond=is_running,
        body=advance,
        label="march_cone_forward",
    )
    dr.eval(d_radiance, d_through)
    return d_radiance, d_through


def march_backward(
    march: MarchInputs,
    lanes: Lanes,
    words: mi.Float | None,
    total: tuple[mi.Color3f, mi.Float],
    adjoint: tuple[mi.Color3f, mi.Float],
) -> tuple[Lanes, mi.Float | None]:
    """Return the derivatives of a sum over what a march returns by what it follows from.

    Parameters
    ----------
    march, lanes, words
        What the march follows from.
    total
        Radiance and transmittance that it returned.
    adjoint
        Derivatives of the sum by these two.

    Returns
    -------
    tuple
        Derivatives by the wanted numbers, a lane each, and by the words.
    """
    dr.eval(adjoint)
    none = dr.zeros(mi.Float, dr.width(lanes["t"]))
    names = march.wanted
    active, least = march.active, march.config.min_transmittance
    d_radiance, d_through = mi.Color3f(adjoint[0]), mi.Float(adjoint[1])
    # What is behind a step, weighed as the sum weighs it; the parts before it are taken off.
    weighed = mi.Float(dr.dot(d_radiance, total[0])) + d_through * total[1]
    held = None
    if words is not None:
        held = mi.Float(words)
        dr.enable_grad(held)

    def is_running(t: mi.Float, through: mi.Float, *_: Any) -> mi.Bool:
        return active & (t < lanes["t_end"]) & (through > least)

    def advance(
        t: mi.Float,
        through: mi.Float,
        is_first: mi.Bool,
        behind: mi.Float,
        tangents: list[mi.Float],
        found: list[mi.Float],
    ) -> tuple[Any, ...]:
        with dr.resume_grad():  # type: ignore[no-untyped-call]
            # Where the next step begins follows from this one.
            local, at = march.attached(lanes), mi.Float(t)
            dr.enable_grad(at)
            t_next = advanced(at, march.step(local, at, is_first))
            dr.backward(t_next)
            along = dr.grad(at)
            slopes = [dr.grad(local[name]) for name in names]

            # What this step sees, and what it takes from all behind it.
            local, at = march.attached(lanes), mi.Float(t)
            dr.enable_grad(at)
            step = march.step(local, at, is_first)
            stopped, seen = read_step(
                march.voxels(held), march.cone(local), at, step, march.rules(local)
            )
            own = mi.Float(dr.dot(d_radiance, seen)) * through
            passed = 1.0 - dr.detach(stopped)
            after = behind - dr.detach(own)
            dimmed = dr.select(passed > 0.0, after / dr.select(passed > 0.0, passed, 1.0), 0.0)
            dr.backward(own - stopped * dimmed)
            by_place = dr.grad(at)
            by_number = [dr.grad(local[name]) for name in names]
        found = [
            total + by + by_place * tangent
            for total, by, tangent in zip(found, by_number, tangents, strict=True)
        ]
        tangents = [
            along * tangent + slope for tangent, slope in zip(tangents, slopes, strict=True)
        ]
        return dr.detach(t_next), through * passed, mi.Bool(False), after, tangents, found

    *_, found = dr.while_loop(
        state=(
            mi.Float(lanes["t"]),
            none + 1.0,
            none == 0.0,
            weighed + none,
            [none + (1.0 if name == "t" else 0.0) for name in names],
            [mi.Float(none) for _ in names],
        ),
        cond=is_running,
        body=advance,
        label="march_cone_backward",
    )
    dr.eval(found)
    return dict(zip(names, found, strict=True)), None if held is None else dr.grad(held)
