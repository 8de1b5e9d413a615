"""Dynamic movement primitives."""
