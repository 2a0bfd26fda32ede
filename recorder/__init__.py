"""From a robot to a session: what it says, over which line, and how it is kept in MCAP."""
