"""A robot that is not there: rooms, what its sensors hear in them, and its serial line."""
