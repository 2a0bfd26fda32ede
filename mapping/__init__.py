"""From a session to a map: each reading, each grid, each border and line as an artifact."""
