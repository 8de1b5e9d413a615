"""Sessions: reading, recording, and the journal of a running episode."""
