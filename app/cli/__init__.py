"""The command line: options, and one call a command."""
