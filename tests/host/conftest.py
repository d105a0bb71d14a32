"""Set up before any test imports numpy."""

import os

# Fits are small: on a machine that is busy, threads cost ten times what they gain.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
