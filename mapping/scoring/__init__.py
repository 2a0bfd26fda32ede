"""How good a map is: against the readings that it was not made of."""
