"""Running an episode in a process of its own."""
