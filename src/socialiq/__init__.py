"""Driving policies of a declared social angle, learned from mixed demonstrations."""

from socialiq.worlds.ids import register as _register

_register()
