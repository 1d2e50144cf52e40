"""The claims of chapter 8, section by section; importing a section registers its claims."""
