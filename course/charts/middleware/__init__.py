"""The charts of chapter 10: middleware and real time."""
