"""Expressions of plan files: text → checked tree → sympy, and compiled value, gradient and Hessian."""
