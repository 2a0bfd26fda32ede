"""Pictures of maps for slides and documents, drawn with one style sheet: PNG, SVG and PDF."""
