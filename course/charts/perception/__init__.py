"""Charts of chapter 7."""
