"""What is known in flight: charge, motion power, ratio of times, false readings of power, parameters flown.

A filter takes readings through one method, `ingest`: sequences of one reading or more, in order. Its state is made of
NamedTuples; its functions return new ones, run in plain Python and may be compiled.
"""
