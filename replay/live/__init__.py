"""Record, map and show at once: the mapping follows the recording in a process of its own."""
