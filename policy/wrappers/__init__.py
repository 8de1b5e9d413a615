"""Wrappers and combinations of policies."""
