"""The stages of a frame, each a function of its inputs and its config."""

from __future__ import annotations
