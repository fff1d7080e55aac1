"""Style and drawing helpers of all figures."""
