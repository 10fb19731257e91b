"""Records of runs and the reports made from them; never renders."""

from __future__ import annotations
