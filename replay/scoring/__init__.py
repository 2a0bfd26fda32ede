"""Maps held against the truth: what is judged, the report, the picture."""
