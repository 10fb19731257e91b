"""Downsampling: every level is filled from the finer one, where that covers it.

Start reading at `levels.py`; `packed.py` does the same for all of a volume on the way to where
cones read it.
"""

from __future__ import annotations

from vctgi.stages.downsampling.config import DEFAULT_DOWNSAMPLING as DEFAULT_DOWNSAMPLING
from vctgi.stages.downsampling.config import DownsamplingConfig as DownsamplingConfig
from vctgi.stages.downsampling.config import MipRule as MipRule
from vctgi.stages.downsampling.levels import downsample as downsample
from vctgi.stages.downsampling.levels import downsample_regions as downsample_regions
from vctgi.stages.downsampling.packed import downsample_volume as downsample_volume
