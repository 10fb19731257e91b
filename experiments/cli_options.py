"""Options that several commands share, with the words that `--help` says of them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

DEFAULT_CACHE = "the user's cache folder, or $VCTGI_CACHE"

Preset = Annotated[
    str,
    Parameter(
        help="Named configuration: ambient, medium, high, ultra, or the recipe of another system, "
        "such as peer:compix, with its own scale peer:compix:published, or a preset file "
        "(.toml), as `vctgi optimize` writes it; a wrong name lists all."
    ),
]
Presets = Annotated[
    list[str],
    Parameter(
        help="Named configurations to compare: repeat the option or part names by commas. 'all': "
        "medium, high, ultra; 'peers': the recipes of other systems, with their own scale and "
        "without; a wrong name lists all.",
        negative="",
    ),
]
Resolution = Annotated[
    int,
    Parameter(
        help="Longer edge of the picture, pixels. Left out: 256 for a report, the scene's own size "
        "for a render, and always the scene's own for a film with a crop window."
    ),
]
Spp = Annotated[int, Parameter(name="--spp", help="Paths a pixel of the reference.")]
Variant = Annotated[
    str | None, Parameter(help="llvm_ad_rgb or cuda_ad_rgb; chosen by the machine if left out.")
]
Sensor = Annotated[int, Parameter(help="Which camera of the scene.")]
Cache = Annotated[
    Path | None, Parameter(help=f"Where references are kept; default: {DEFAULT_CACHE}.")
]
Keep = Annotated[
    list[str] | None,
    Parameter(
        help="Keep what the scene does not need, by the names that `vctgi plan` shows, or all; may "
        "be repeated or part names by commas.",
        negative="",
    ),
]
JsonFile = Annotated[
    Path | None, Parameter(name="--json", help="Write machine-readable results to this file.")
]
