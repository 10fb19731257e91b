"""Decisions of the plan in words, and those that follow from what is asked for alone."""

from __future__ import annotations

from dataclasses import dataclass

from vctgi.config import RenderConfig


@dataclass(frozen=True, kw_only=True)
class PlanEntry:
    """One decision: what, whether it is kept, why, and what leaving it out saved."""

    item: str
    kept: bool
    reason: str
    saved: str = ""


def ambient_entries(config: RenderConfig) -> list[PlanEntry]:
    """Say what a frame without light leaves out."""
    reason = 'mode = "ambient": only opacity is read'
    left_out = {
        "reflective shadow maps": "the survey of the lights, and their maps",
        "light injection": "sums of light, and emittance at every level of downsampling",
        "bounces from voxel to voxel": "cones of every voxel with a surface",
        "environment at the end of a cone": "its average over cones",
        "diffuse and specular cones": "reads of emittance, and the measuring of lobes",
    }
    return [
        PlanEntry(
            item="ambient occlusion",
            kept=True,
            reason=f"{config.ambient.cone_count} cones through opacity alone",
        ),
        *(
            PlanEntry(item=item, kept=False, reason=reason, saved=saved)
            for item, saved in left_out.items()
        ),
    ]


def sparse_entry(config: RenderConfig) -> PlanEntry:
    """Say how many pixels trace diffuse cones."""
    sparsity = config.reconstruction.sparsity
    item = "diffuse cones of every camera ray"
    if sparsity == 1:
        return PlanEntry(item=item, kept=True, reason="reconstruction.sparsity = 1")
    is_once = config.reconstruction.is_traced_once
    share = 1.0 - 1.0 / (sparsity * (config.samples_per_pixel if is_once else 1))
    return PlanEntry(
        item=item,
        kept=False,
        reason=f"reconstruction.sparsity = {sparsity}: one of {sparsity} traces cones, the others "
        "interpolate or, where they find no neighbour, trace too",
        saved=f"up to {share:.1%} of these cones",
    )
