"""The charts of chapter 3: one scene on several simulators."""
