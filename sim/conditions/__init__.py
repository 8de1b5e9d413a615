"""Conditions of a simulation: every key of ``--set``, and seeded variations of them."""
