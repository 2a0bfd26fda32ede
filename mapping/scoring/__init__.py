"""How good a map and its lines are: against walls that are known, or without."""
