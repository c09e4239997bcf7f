#!/usr/bin/env python3
from rocon_flip.nodes.command import pull_hub_publisher

raise SystemExit(pull_hub_publisher())
