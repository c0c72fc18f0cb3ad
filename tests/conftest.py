"""Settings of every test process."""

import os

# As many processes as cores run already; set here, before NumPy is imported, and inherited by all of them.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
