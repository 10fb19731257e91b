"""Measure how exact the light is that cones gather, and what each way to save costs.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations
