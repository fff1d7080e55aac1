"""Methods that others have published, written from their papers."""
