"""`train`: a sub-command a learner, and the options that they share."""
