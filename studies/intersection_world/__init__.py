"""The intersection under rule-based drivers, and the rewards of each variant (thesis 5.1.3)."""
