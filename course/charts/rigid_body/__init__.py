"""The charts of chapter 1; importing a section registers its charts."""
