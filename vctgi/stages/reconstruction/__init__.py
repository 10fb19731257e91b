"""Reconstruction: pictures from light that was traced sparsely or with noise."""

from __future__ import annotations
