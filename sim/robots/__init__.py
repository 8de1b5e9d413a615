"""The robots that hold the cloth."""
