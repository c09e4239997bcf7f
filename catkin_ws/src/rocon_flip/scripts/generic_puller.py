#!/usr/bin/env python3
from rocon_flip.nodes.command import generic_puller

raise SystemExit(generic_puller())
