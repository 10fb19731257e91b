"""Decisions of the plan in words, and those that follow from what is asked for alone."""

from __future__ import annotations

from dataclasses import dataclass

from vctgi.config import RenderConfig
from vctgi.eliminations import ELIMINATIONS
from vctgi.scene.materials import Material


@dataclass(frozen=True, kw_only=True)
class PlanEntry:
    """One decision.

    Attributes
    ----------
    item, kept, reason
        What, whether it is kept, and why.
    saved
        What leaving it out saved.
    bound
        How far that moves the picture: "bit for bit", or a proved bound; empty where the
        configuration asks for another picture.
    override
        What keeps it: a name for `RenderConfig.keep`, as the command line has it, or a field of the
        configuration.
    """

    item: str
    kept: bool
    reason: str
    saved: str = ""
    bound: str = ""
    override: str = ""


def left_out_entry(
    name: str, *, item: str, reason: str, saved: str, bound: str | None = None
) -> PlanEntry:
    """Return the entry of what a scene does not need, by its name among `ELIMINATIONS`."""
    return PlanEntry(
        item=item,
        kept=False,
        reason=reason,
        saved=saved,
        bound=ELIMINATIONS[name].bound if bound is None else bound,
        override=f"--keep {name}",
    )


def needed_entry(
    name: str,
    config: RenderConfig,
    *,
    item: str,
    needs: str,
    lacks: str,
    saved: str,
    bound: str | None = None,
) -> PlanEntry:
    """Return the entry of what is kept if the scene needs it, or if it is asked for.

    Parameters
    ----------
    name
        Among `ELIMINATIONS`.
    config
        What is asked for.
    item
        What it is about.
    needs
        Why the scene needs it; empty where it does not.
    lacks
        Why it does not.
    saved, bound
        What leaving it out saved, and how far it moves the picture.
    """
    if needs:
        return PlanEntry(item=item, kept=True, reason=needs)
    if config.is_kept(name):
        return PlanEntry(item=item, kept=True, reason=f"asked for by keep {name}; {lacks}")
    return left_out_entry(name, item=item, reason=lacks, saved=saved, bound=bound)


def ambient_entries(config: RenderConfig) -> list[PlanEntry]:
    """Say what a frame without light leaves out."""
    reason = 'mode = "ambient": only opacity is read'
    lit = {
        "reflective shadow maps": "the survey of the lights, and their maps",
        "light injection": "sums of light, and emittance at every level of downsampling",
        "bounces from voxel to voxel": "cones of every voxel with a surface",
        "environment at the end of a cone": "its average over cones",
    }
    return [
        PlanEntry(
            item="ambient occlusion",
            kept=True,
            reason=f"{config.ambient.cone_count} cones through opacity alone",
        ),
        *(
            needed_entry("light", config, item=item, needs="", lacks=reason, saved=saved)
            for item, saved in lit.items()
        ),
        PlanEntry(
            item="diffuse and specular cones",
            kept=False,
            reason=reason,
            saved="reads of emittance, and the measuring of lobes",
            override="mode",
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
        override="reconstruction.sparsity",
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


def emission_entry(config: RenderConfig, emissive_count: int) -> PlanEntry:
    """Say whether emitters shine from voxels too."""
    item, saved = "emission in voxels", "emittance voxelization"
    if not config.emission_in_voxels:
        return PlanEntry(
            item=item,
            kept=False,
            reason="light straight from an emitter is direct light, which Mitsuba renders",
            saved=saved,
            override="emission_in_voxels",
        )
    asked = f"asked for by emission_in_voxels: {emissive_count} triangles shine"
    return needed_entry(
        "emission",
        config,
        item=item,
        needs=asked if emissive_count else "",
        lacks="no surface shines by itself",
        saved=saved,
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
            override="scattering_count",
        )
    share = config.bounces.min_bounce_share
    if config.is_kept("bounces") or share == 0.0:
        return PlanEntry(
            item="bounces from voxel to voxel",
            kept=True,
            reason=f"scattering_count = {config.scattering_count}: all {config.bounce_count}",
        )
    return PlanEntry(
        item="bounces from voxel to voxel",
        kept=True,
        reason=f"scattering_count = {config.scattering_count}: up to {config.bounce_count}, "
        f"stopping once one adds less than {share:g} of the flux before it",
        bound=ELIMINATIONS["bounces"].bound,
        override="--keep bounces",
    )


def sky_entries(config: RenderConfig, *, has_sky: bool, lacks: str) -> list[PlanEntry]:
    """Say where the environment is looked up, if there is one; `lacks` says why there is none."""
    item = "environment at the end of a cone"
    if config.sky_in_cones:
        asked = "asked for: the frame holds the direct light of the sky too"
        needs = asked if has_sky else ""
        saved = "one lookup a cone"
        entry = needed_entry("sky", config, item=item, needs=needs, lacks=lacks, saved=saved)
    else:
        reason = "light straight from the sky is direct light, which Mitsuba renders"
        entry = PlanEntry(
            item=item,
            kept=False,
            reason=reason if has_sky else lacks,
            saved="one lookup a cone",
            override="sky_in_cones",
        )
    entries = [entry]
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
                override="" if is_kept else "sky_lighting",
            )
        )
    elif config.sky_lighting == "cones":
        entries.append(
            needed_entry(
                "sky",
                config,
                item="environment at the end of a voxel's cone",
                needs="",
                lacks=lacks,
                saved="cones of every voxel with a surface",
            )
        )
    return entries
