"""Decisions of the plan in words, and those that follow from what is asked for alone."""

from __future__ import annotations

from dataclasses import dataclass

from vctgi.config import RenderConfig
from vctgi.scene.materials import Material


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


def anisotropy_entries(materials: list[Material]) -> list[PlanEntry]:
    """Say that lobes of anisotropic roughness are not what they are."""
    kinds = sorted({m.kind for m in materials if m.is_anisotropic})
    if not kinds:
        return []
    return [
        PlanEntry(
            item="anisotropic lobes",
            kept=False,
            reason="approximated by round cones of the same mean direction: " + ", ".join(kinds),
            saved="cones that are wider one way than across",
        )
    ]


def emission_entry(config: RenderConfig) -> PlanEntry:
    """Say whether emitters shine from voxels too."""
    item = "emission in voxels"
    if config.emission_in_voxels:
        return PlanEntry(item=item, kept=True, reason="asked for by emission_in_voxels")
    return PlanEntry(
        item=item,
        kept=False,
        reason="light straight from an emitter is direct light, which Mitsuba renders",
        saved="emittance voxelization",
    )


def bounce_entry(config: RenderConfig) -> PlanEntry:
    """Say which bounces are traced, and when they stop."""
    if config.bounce_count == 0:
        return PlanEntry(
            item="bounces from voxel to voxel",
            kept=False,
            reason=f"scattering_count = {config.scattering_count}: one bounce, from lit voxels to "
            "the eye",
            saved="cones of every voxel with a surface",
        )
    share = config.bounces.min_bounce_share
    return PlanEntry(
        item="bounces from voxel to voxel",
        kept=True,
        reason=f"scattering_count = {config.scattering_count}: up to {config.bounce_count}, "
        f"stopping once one adds less than {share:g} of the flux before it",
    )


def sky_entries(config: RenderConfig, *, has_sky: bool) -> list[PlanEntry]:
    """Say where the environment is looked up."""
    if not has_sky:
        reason = "the scene has no environment"
    elif config.sky_in_cones:
        reason = "asked for: the frame holds the direct light of the sky too"
    else:
        reason = "light straight from the sky is direct light, which Mitsuba renders"
    is_seen = has_sky and config.sky_in_cones
    entries = [
        PlanEntry(
            item="environment at the end of a cone",
            kept=is_seen,
            reason=reason,
            saved="" if is_seen else "one lookup a cone",
        )
    ]
    if has_sky:
        is_kept = config.sky_lighting == "cones"
        entries.append(
            PlanEntry(
                item="environment at the end of a voxel's cone",
                kept=is_kept,
                reason="lights the voxels in the place of a reflective shadow map"
                if is_kept
                else "a reflective shadow map of it lights the voxels",
                saved="" if is_kept else "cones of every voxel with a surface",
            )
        )
    return entries
