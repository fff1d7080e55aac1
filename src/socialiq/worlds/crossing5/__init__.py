"""crossing5, the deterministic 5x5 proof of concept (thesis 5.1.1)."""

from socialiq.worlds.crossing5.options import Options
from socialiq.worlds.crossing5.world import make

__all__ = ["Options", "make"]
