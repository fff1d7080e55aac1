"""Every place where the social prior can enter, and the baselines, at one budget."""
