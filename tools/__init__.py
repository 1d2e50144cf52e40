"""What builds, warms and serves the course; not part of the installed package."""
