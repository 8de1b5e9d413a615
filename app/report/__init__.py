"""Pages for a browser that need nothing else: pictures and films inside, no scripts, no network."""
