"""Exact facts about the two gridworlds and their experts (thesis 5.1, 5.2, Fig 6.3)."""
