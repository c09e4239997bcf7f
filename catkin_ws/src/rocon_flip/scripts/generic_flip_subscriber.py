#!/usr/bin/env python3
from rocon_flip.nodes.command import generic_flip_subscriber

raise SystemExit(generic_flip_subscriber())
