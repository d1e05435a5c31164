"""The use cases of eadp, a module a command: what `import eadp` shows, and what the commands call."""
