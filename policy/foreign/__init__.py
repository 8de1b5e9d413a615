"""Policies that are not part of Layflat: a factory of the user's, and a policy server."""
