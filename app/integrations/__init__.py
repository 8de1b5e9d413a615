"""Adapters to other people's programs, each imported only with that program."""
