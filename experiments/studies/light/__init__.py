"""Study "light": does the power of every light arrive in the voxels, in the right place?

The study is the sum of its parts, one module each.
"""

from __future__ import annotations
