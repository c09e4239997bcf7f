#!/usr/bin/env python3
from rocon_flip.nodes.command import generic_flip_publisher

raise SystemExit(generic_flip_publisher())
