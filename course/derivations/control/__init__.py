"""The claims of chapter 6, section by section; importing a section registers its claims."""
