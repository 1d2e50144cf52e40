"""The exercises: one folder each, with card.toml, prompt.md, starter.py and exercise.py."""
