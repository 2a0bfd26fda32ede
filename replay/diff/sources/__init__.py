"""One module a kind of source; each turns a path into a :class:`replay.diff.layers.Source`."""
