"""Study "growth": how cost grows with what there is, in time, counts and memory.

`axes.py` says what is made larger and what work that is; `exponents.py` fits; `rows.py` lists the
numbers.
"""

from __future__ import annotations

from experiments.studies.growth.rows import DEFINITIONS as DEFINITIONS
from experiments.studies.growth.rows import checks as checks
