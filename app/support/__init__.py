"""Tools that every part of the application uses: errors, progress, statistics, formatting."""
