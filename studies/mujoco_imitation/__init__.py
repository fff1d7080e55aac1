"""Imitation on Gymnasium's MuJoCo tasks, an outside check of the learners of continuous actions."""
