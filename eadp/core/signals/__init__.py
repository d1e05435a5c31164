"""Sampled power: Fourier state, Kalman update, spectrum, coloured noise."""
