"""Shared reward of demonstrators: r_i = f + cos a_i r_env + sin a_i r_social.

IQ-Learn with the thesis' prior takes every demonstrator for one of the target angle. Here each has
its own, given or inferred, and what neither reward explains is learned once from all of them: a
skill f that goes with any angle.
"""
