"""How an episode begins."""
