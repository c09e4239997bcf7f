#!/usr/bin/env python3
import pioneer_node.nodes.light  # noqa: F401
from rocon_gateway.nodes.gateway import main

raise SystemExit(main())
