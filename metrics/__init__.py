"""How far an image is from its reference, with error bars.

NumPy arrays in, numbers out: nothing here knows a renderer. `measure` runs every image metric;
each is also a function of its own.
"""

from __future__ import annotations

from metrics.aliasing import pop_share as pop_share
from metrics.aliasing import power_ripple as power_ripple
from metrics.aliasing import recentring_difference as recentring_difference
from metrics.aliasing import temporal_difference_error as temporal_difference_error
from metrics.aliasing import temporal_difference_rms as temporal_difference_rms
from metrics.banding import phase_spread as phase_spread
from metrics.banding import structured_power as structured_power
from metrics.banding import structured_share as structured_share
from metrics.colour_difference import delta_e_2000 as delta_e_2000
from metrics.colour_difference import delta_e_itp as delta_e_itp
from metrics.confidence import Estimate as Estimate
from metrics.confidence import jackknife as jackknife
from metrics.display import DisplaySettings as DisplaySettings
from metrics.display import auto_exposure as auto_exposure
from metrics.display import display_settings as display_settings
from metrics.display import nits_per_unit as nits_per_unit
from metrics.display import srgb_from_linear as srgb_from_linear
from metrics.display_banding import display_banding as display_banding
from metrics.display_banding import display_banding_excess as display_banding_excess
from metrics.energy import energy_ratio as energy_ratio
from metrics.finite import FiniteCheck as FiniteCheck
from metrics.finite import check_finite as check_finite
from metrics.finite import require_finite as require_finite
from metrics.flicker import Motion as Motion
from metrics.flicker import flicker_rms as flicker_rms
from metrics.flicker import motion_of as motion_of
from metrics.flicker_parts import flicker_noise as flicker_noise
from metrics.flicker_parts import flicker_structure as flicker_structure
from metrics.leaking import LeakAudit as LeakAudit
from metrics.leaking import audit_shares as audit_shares
from metrics.leaking import one_sided_excess as one_sided_excess
from metrics.leaking import sealed_room_ratio as sealed_room_ratio
from metrics.leaking import share_of_choices as share_of_choices
from metrics.measurement import Measurement as Measurement
from metrics.moving_bands import MovingBands as MovingBands
from metrics.moving_bands import moving_bands as moving_bands
from metrics.perceptual import FlipResult as FlipResult
from metrics.perceptual import FlipSettings as FlipSettings
from metrics.perceptual import flip as flip
from metrics.perceptual import flip_exposures as flip_exposures
from metrics.perceptual import mean_flip as mean_flip
from metrics.squared_error import mean_relative_error as mean_relative_error
from metrics.squared_error import mse as mse
from metrics.squared_error import reference_noise_relmse as reference_noise_relmse
from metrics.squared_error import relmse_e001 as relmse_e001
from metrics.squared_error import relmse_e2 as relmse_e2
from metrics.structural import pq_from_nits as pq_from_nits
from metrics.structural import ssim_pq as ssim_pq
from metrics.suite import measure as measure
from metrics.voxel_period import voxel_period_rms as voxel_period_rms
from metrics.voxel_period import voxel_period_share as voxel_period_share
