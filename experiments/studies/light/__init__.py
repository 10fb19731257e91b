"""Study "light": how the power of every light arrives in the voxels, and what becomes of it.

The study is the sum of its parts, one module each.
"""

from __future__ import annotations
