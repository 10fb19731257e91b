"""Path-traced truth: Mitsuba's path tracer, in components with variance, cached."""

from __future__ import annotations

from reference.cache import default_cache_directory as default_cache_directory
from reference.denoised import DenoisedFrame as DenoisedFrame
from reference.denoised import DenoiserMissingError as DenoiserMissingError
from reference.denoised import denoise as denoise
from reference.denoised import render_denoised as render_denoised
from reference.noise import LEAST_FACTOR as LEAST_FACTOR
from reference.noise import NoiseFloor as NoiseFloor
from reference.noise import NoisyReferenceError as NoisyReferenceError
from reference.noise import noise_floor as noise_floor
from reference.noise import require_low_noise as require_low_noise
from reference.noise import target_from_difference as target_from_difference
from reference.path_trace import reference_key as reference_key
from reference.path_trace import render_reference as render_reference
from reference.probes import ProbeIrradiance as ProbeIrradiance
from reference.probes import probe_irradiance as probe_irradiance
from reference.request import COMPONENT_NAMES as COMPONENT_NAMES
from reference.request import DERIVED_NAMES as DERIVED_NAMES
from reference.request import Reference as Reference
from reference.request import ReferenceRequest as ReferenceRequest
from reference.scene_digest import scene_digest as scene_digest
from reference.target import ReferenceTarget as ReferenceTarget
from reference.target import render_to_target as render_to_target
