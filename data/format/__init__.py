"""The layout of a session file: schema, encoding, decoding, checks."""
