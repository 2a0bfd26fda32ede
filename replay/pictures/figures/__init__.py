"""Every figure of the lecture chapter, drawn again from any session."""
