"""The value log of a recording: every value that every layer ever held, bit for bit, in few bytes.

Pictures in a recording are rounded. For programs the exact values (float32) lie beside them: whole
tiles at whole maps, and between these a log, one record a reading. This package is that log, and
nothing else uses its parts: what it writes below :data:`replay.rrd.layout.VALUE_LOG`, the viewer
never shows, and :class:`replay.rrd.reader.RrdRecording` plays back.

Why it is small: a Bayesian reading multiplies the odds of each cell that it covers by a factor, and
in front of the echo the factor depends on the distance from the sensor alone. So the values are
*predicted*, and a record holds only the reading's outline, the few factors of its band, and the
cells that came out differently. Of the rule ``pooled`` writer and reader follow the sums of every
cell instead, from the first reading on; a record then holds an outline and a range.

| module | what it does |
| --- | --- |
| ``log`` | the layers of one run: which records wait, and at which step each belongs |
| ``encoder`` | a layer's readings → records; learns what a sensor's readings do by distance |
| ``radial_profile`` | that function of the distance as a table, from many samples |
| ``sums`` | how sums grow, and the values they stand for, by products and sums alone |
| ``records`` | the bytes of a record, both ways; each carries a checksum of what it must come to |
| ``track`` | values and odds of all cells, as writer and reader both follow them |
| ``playback`` | tiles and records in the order of the steps → the values at any step |
| ``kernels`` | the compiled loops; their slow twins are ``tests/naive_predicting.py`` |

Only sums, products, divisions and square roots are used, in one order: the same bits come out on
every machine. A record that is missing or does not come out right raises ``ValueLogError``. How
much it saves: ``docs/recording-size.md``.
"""
