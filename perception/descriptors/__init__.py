"""Descriptors of wrinkles (WORD, HOW, HOG) behind one protocol, with a registry by name."""
