"""Reflective shadow maps: where the light of each emitter first lands.

A texel is a ray that leaves the emitter with a share of its power, as Mitsuba's own emitter
sampling gives it, so every emitter that Mitsuba can sample has a map. All lamps inside the scene
share one launch and one map, in which each texel knows its light. Light from outside (directional,
sky) gets one map for each clip level, aimed at what that level's window can see of it.

Start reading at `maps.py`.
"""

from __future__ import annotations

from vctgi.stages.reflective_shadow_map.all_levels import trace_all_levels as trace_all_levels
from vctgi.stages.reflective_shadow_map.config import (
    ReflectiveShadowMapConfig as ReflectiveShadowMapConfig,
)
from vctgi.stages.reflective_shadow_map.distant import survey_distant as survey_distant
from vctgi.stages.reflective_shadow_map.kept import KeptLight as KeptLight
from vctgi.stages.reflective_shadow_map.lamps import survey_lamps as survey_lamps
from vctgi.stages.reflective_shadow_map.maps import (
    render_reflective_shadow_maps as render_reflective_shadow_maps,
)
