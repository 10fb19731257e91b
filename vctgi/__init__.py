"""Voxel cone tracing for Mitsuba 3: clipmap voxels, lit by reflective shadow maps, read by cones.

Importing the package registers the integrator `vctgi` with Mitsuba, for the variant that is set and
for those that are set later.
"""

from __future__ import annotations

from vctgi.config import PRESETS as PRESETS
from vctgi.config import RenderConfig as RenderConfig
from vctgi.config import preset as preset
from vctgi.errors import SceneError as SceneError
from vctgi.following import FollowedScene as FollowedScene
from vctgi.following import follow_scene as follow_scene
from vctgi.integrator import register as _register
from vctgi.parameters import ConeParameters as ConeParameters
from vctgi.pipeline import accumulate_frame as accumulate_frame
from vctgi.pipeline import light_volume as light_volume
from vctgi.pipeline import prepare_scene as prepare_scene
from vctgi.pipeline import render_frame as render_frame
from vctgi.probes import probe_irradiance as probe_irradiance
from vctgi.trace_cache import TraceCache as TraceCache

_register()
