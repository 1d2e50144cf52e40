"""The charts of chapter 11: the whole pipeline."""
