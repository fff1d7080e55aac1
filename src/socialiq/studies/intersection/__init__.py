"""The intersection study: experts, demonstrations, learners, evaluation (thesis 5.2-6.3, 7, A)."""
