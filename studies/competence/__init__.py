"""Value of demonstrations beyond reinforcement learning on R(α)."""
