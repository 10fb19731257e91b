"""Study "pareto": error against run time, of cones, of paths and of denoised paths.

All render indirect light of the same number of scatterings and share the reference's direct light,
so that every difference is one of indirect light. `rows.py` lists the numbers.
"""

from __future__ import annotations

from experiments.studies.pareto.definitions import DEFINITIONS as DEFINITIONS
from experiments.studies.pareto.rows import checks as checks
