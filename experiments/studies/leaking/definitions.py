"""What the numbers of the study "leaking" are."""

from __future__ import annotations

from reports.study_figures import Definition

METRICS = "metrics/leaking.py"

DEFINITIONS = (
    Definition(
        name="L1, sealed room",
        formula="mean light in a closed dark room / mean light in the lit room beside it; the "
        "truth is 0",
        source=f"{METRICS}, sealed_room_ratio; intervals over places of the scene in the lattice",
    ),
    Definition(
        name="L2, leak_through",
        formula="light that cones read where geometry lies between them and the place / light "
        "gathered: of a step with transmittance T, of whose cone the share V truly reaches it, "
        "max(0, 1 - V / T)",
        source=f"{METRICS}, audit_shares; vctgi/debug/leak_march.py; intervals over batches of "
        "probe rays",
    ),
    Definition(
        name="L2, leak_wrong_face",
        formula="sum of max(0, light read in sight - gain R) / light gathered; gain: median "
        "over tiles of 8 x 8 pixels of light read in sight over true light R, so that a factor is "
        "no leak",
        source=f"{METRICS}, audit_shares",
    ),
    Definition(
        name="L2, leak",
        formula="leak_through + leak_wrong_face",
        source=f"{METRICS}, audit_shares",
    ),
    Definition(
        name="missing_light (over-occlusion)",
        formula="sum of max(0, gain R - light read in sight) / light gathered",
        source=f"{METRICS}, audit_shares",
    ),
    Definition(
        name="hidden, blocked",
        formula="light read where no probe reaches, and where a probe taken at random does not: "
        "bounds of leak_through from below and above",
        source="experiments/studies/leaking/audit.py; by one choice a cone: "
        f"{METRICS}, share_of_choices",
    ),
    Definition(
        name="L3, dark_excess",
        formula="sum of max(0, V - R - 3 sigma) where R < 5 % of its mean / sum of R; V by cones, "
        "R by path tracing with standard error sigma, luminance",
        source=f"{METRICS}, one_sided_excess; intervals over batches of the reference",
    ),
    Definition(
        name="L3, missing_energy (over-occlusion)",
        formula="sum of max(0, R - V - 3 sigma) / sum of R",
        source=f"{METRICS}, one_sided_excess",
    ),
)
