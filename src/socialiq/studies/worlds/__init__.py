"""The study `worlds`."""
