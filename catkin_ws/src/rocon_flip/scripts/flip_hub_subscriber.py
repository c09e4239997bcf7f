#!/usr/bin/env python3
from rocon_flip.nodes.command import flip_hub_subscriber

raise SystemExit(flip_hub_subscriber())
