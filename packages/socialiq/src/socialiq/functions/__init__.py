"""Functions for what a user does, with the words, defaults and messages of the commands."""
