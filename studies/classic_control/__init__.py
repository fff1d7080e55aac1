"""IQ-Learn on classic control from few transitions, an outside check of the learner."""
