"""The claims of chapter 10, section by section; importing a section registers its claims."""
