"""The charts of chapter 6; importing a file registers its charts."""
