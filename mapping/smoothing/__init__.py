"""Poses made smooth: each one held against those before and after it."""

from __future__ import annotations

from mapping.smoothing.poses import Noise, noise_of, smoothed_track

__all__ = ["Noise", "noise_of", "smoothed_track"]
