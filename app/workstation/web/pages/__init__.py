"""Pages of the browser workstation."""
