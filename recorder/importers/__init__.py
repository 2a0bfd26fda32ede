"""Other people's logs → messages: one file a format."""
