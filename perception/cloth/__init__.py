"""The state of a cloth from an RGB-D frame: segmentation, contact, free edge; known and unknown cameras."""
