"""`layflat reproduce`: every experiment of the thesis, ours beside its."""
