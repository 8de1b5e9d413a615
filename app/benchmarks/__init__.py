"""`layflat bench`, and the study of WORD."""
