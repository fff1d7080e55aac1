"""The page over a local server: a user's policy, demonstrations, audit or recording in it."""
