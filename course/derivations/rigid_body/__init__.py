"""The claims of chapter 1, section by section; importing a section registers its claims."""
