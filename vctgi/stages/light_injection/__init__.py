"""Light injection: lit points of surfaces become emittance of voxels."""

from __future__ import annotations

from vctgi.stages.light_injection.config import LightInjectionConfig as LightInjectionConfig
from vctgi.stages.light_injection.injection import inject_light as inject_light
from vctgi.stages.light_injection.injection import relit_regions as relit_regions
from vctgi.stages.light_injection.injection import update_emittance as update_emittance
