#!/usr/bin/env python3
import pioneer_node.nodes.light  # noqa: F401
from rocon_hub.nodes.hub import main

raise SystemExit(main())
