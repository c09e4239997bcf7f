#!/usr/bin/env python3
from rocon_flip.nodes.command import flip_remote_publisher

raise SystemExit(flip_remote_publisher())
