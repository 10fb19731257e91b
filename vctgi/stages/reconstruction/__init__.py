"""From gathered light to pictures: sparse pixels filled in, noise filtered, frames blended."""

from __future__ import annotations
