#!/usr/bin/env python3
from rocon_flip.nodes.command import advertise_hub_publisher

raise SystemExit(advertise_hub_publisher())
