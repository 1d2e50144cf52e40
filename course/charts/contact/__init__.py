"""Charts of chapter 2."""
