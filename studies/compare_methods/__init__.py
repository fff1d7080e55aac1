"""Study `compare-methods`: our methods beside those that others have published."""
