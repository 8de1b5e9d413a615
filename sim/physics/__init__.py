"""The seam to physics engines, and the engines."""
