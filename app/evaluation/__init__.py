"""Batches of episodes: planned, isolated from each other, kept as they come, and taken up again."""
