"""What a diagnosis looks like: as text, as JSON, as a page with plots."""
