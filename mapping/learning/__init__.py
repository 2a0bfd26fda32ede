"""What a sensor is like, learned from its own readings."""
