"""A robot that is not there: rooms, what its sensors measure in them, and its serial line."""
