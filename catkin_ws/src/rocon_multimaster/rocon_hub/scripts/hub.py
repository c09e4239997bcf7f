#!/usr/bin/env python3
from rocon_hub.nodes.hub import main

raise SystemExit(main())
