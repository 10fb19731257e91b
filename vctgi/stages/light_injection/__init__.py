"""Light injection: lit points of surfaces become emittance of voxels."""

from __future__ import annotations

from vctgi.stages.light_injection.all_levels import inject_all_levels as inject_all_levels
from vctgi.stages.light_injection.all_levels import is_by_scatter as is_by_scatter
from vctgi.stages.light_injection.config import LightInjectionConfig as LightInjectionConfig
from vctgi.stages.light_injection.injection import inject_light as inject_light
from vctgi.stages.light_injection.injection import relit_regions as relit_regions
from vctgi.stages.light_injection.injection import update_emittance as update_emittance
from vctgi.stages.light_injection.summed_light import SummedLight as SummedLight
