"""Pure functions on floats and arrays: same inputs, same outputs; no files, no randomness of their own."""
