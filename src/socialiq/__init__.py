"""Driving policies of a declared social angle, learned from mixed demonstrations."""

from socialiq.worlds.gym import register as _register

_register()
