"""The exercises: a folder each, with card.toml, prompt.md, exercise.py, a few with starter.py."""
