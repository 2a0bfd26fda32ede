"""Many readings added to a map in one go: the compiled loops of the batch path.

Every loop also runs on a blank window of one reading, and gives there what the batch adds; so a
watched step and a batch come to the same bytes by construction. Log-odds are whole steps of 2^-24
(``steps``), so their sums are the same in any order until a cell reaches its clamp. ``readings``
is what goes in; ``spans`` the cells of a beam; ``fading``, ``regions``, ``counts``, ``masses``,
``axis`` and ``lidar`` what each kind of model and rule adds. Loops take the rows that they own,
a band of neighbouring ones or every so-many-th, so threads share nothing and change no bit.

Three traps of numba are met in every file. int32 + int32 is int64 unless it is cast back, and that
halves the speed. An index that may be negative is checked, and that keeps a loop from being
vectorised, so offsets are unsigned. A vectorised loop leaves its remainder to a slow one, so what
is done to every row or cell is spelled out in ``lanes``, over whole groups of 16 cells and masked;
each such step has a plain loop as its twin.

Importing this package costs nothing; its modules load numba.
"""
