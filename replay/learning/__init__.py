"""What was learned of sensors: the sensor file, the verdict as a page, the figures as CSV."""
