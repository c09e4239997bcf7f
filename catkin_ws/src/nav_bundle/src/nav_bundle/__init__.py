"""Navigation nodes (map_server, amcl, move_base, slam_gmapping) and their launch files."""

import os

# OpenBLAS starts a thread a core, which keep spinning for a while after each product of matrices: for the small ones
# of navigation that costs ten times the work itself. It reads this once, when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
