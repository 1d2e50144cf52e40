"""The claims of chapter 3, section by section; importing a section registers its claims."""
