"""The command line: one thin file per command."""

import os

# The matrices here are small: threads of the linear algebra cost more than they give, and on a busy machine twentyfold.
# Set before a command imports numpy, which reads it once; a user's own setting stays.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")
