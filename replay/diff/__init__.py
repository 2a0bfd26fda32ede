"""How two maps differ: which layer, which cells, by how much, and what that means for the room.

Every kind of source becomes the same few things (:mod:`replay.diff.layers`); from there on it does
not matter where a map came from. :func:`replay.diff.comparing.compare` is the way through.
"""
