"""The compiled loops of raster to vector: border tracing and splitting, merging, clustering.

Only modules of this package and :mod:`mapping.kernels` import numba. Importing one of them costs a
good part of a second, so the callers do it inside their functions. Slow, obvious twins of every
kernel stand in the tests.
"""
