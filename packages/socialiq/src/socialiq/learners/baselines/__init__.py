"""Methods that others have published, on the learner kernel, for `socialiq compare methods`."""
