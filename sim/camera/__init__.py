"""The RGB-D camera, images for people, and depth noise."""
