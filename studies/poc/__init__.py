"""The 5x5 proof of concept (thesis 6.1, Fig 6.1): action sequences of baseline and targets."""
