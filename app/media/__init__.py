"""Images, videos, plots and RGB-D files."""
