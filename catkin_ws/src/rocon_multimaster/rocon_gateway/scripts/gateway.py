#!/usr/bin/env python3
from rocon_gateway.nodes.gateway import main

raise SystemExit(main())
