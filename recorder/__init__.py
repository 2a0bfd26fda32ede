"""From a robot to a session: what it measures, over which line, and how it is kept in MCAP."""
