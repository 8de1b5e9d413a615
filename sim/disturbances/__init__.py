"""Forces on the cloth from outside."""
