"""Navigation nodes (map_server, amcl, move_base, slam_gmapping) and their launch files."""

import os

# OpenBLAS starts one thread per core, and these threads spin for a while after each matrix product. For the small
# matrices here, that costs ten times the work itself. OpenBLAS reads the variable once, when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
