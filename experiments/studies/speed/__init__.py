"""Study "speed": whether cones outrun paths that are as exact, and read at full rate.

`rows.py` lists the numbers.
"""

from __future__ import annotations

from experiments.studies.speed.rows import DEFINITIONS as DEFINITIONS
from experiments.studies.speed.rows import checks as checks
