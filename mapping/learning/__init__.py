"""What can be learned of sensors: from rooms with known walls, or from a session itself."""
