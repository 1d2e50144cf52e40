"""The claims of chapter 12."""
