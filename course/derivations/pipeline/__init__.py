"""The claims of chapter 11, section by section; importing a section registers its claims."""
