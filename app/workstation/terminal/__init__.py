"""Recording in a terminal, without a window."""
