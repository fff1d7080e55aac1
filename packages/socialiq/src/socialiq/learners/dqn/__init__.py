"""Deep Q-learning on R(α): the experts of thesis 5.2."""
