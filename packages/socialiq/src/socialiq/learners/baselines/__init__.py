"""Methods that others have published, on the learner kernel; `compare-methods` runs them."""
