"""Gaussian mixture regression."""
