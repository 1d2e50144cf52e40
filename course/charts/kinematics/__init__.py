"""Charts of chapter 4: arms."""
