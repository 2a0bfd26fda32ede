"""The compiled loops of the value log by name; see :mod:`mapping.kernels.loops`."""

from __future__ import annotations

from mapping.kernels.loops import Loop

_KERNELS = "replay.rrd.value_log.kernels"

covered_cells = Loop(_KERNELS, "covered_cells")
some_of = Loop(_KERNELS, "some_of")
distances_m = Loop(_KERNELS, "distances_m")
share_fitting = Loop(_KERNELS, "share_fitting")
front_factors = Loop(_KERNELS, "front_factors")
predict = Loop(_KERNELS, "predict")
settle = Loop(_KERNELS, "settle")
other_changes = Loop(_KERNELS, "other_changes")
follow_sums = Loop(_KERNELS, "follow_sums")
values_of_sums = Loop(_KERNELS, "values_of_sums")
