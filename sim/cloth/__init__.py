"""Size, mesh, geometry and ground truth of a cloth."""
