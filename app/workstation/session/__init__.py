"""Interactive sessions: recording and placing in a process of their own."""
