"""Cameras and the table that they look at: pinhole model, intrinsics, fitted table plane, rectified view."""
