#!/usr/bin/env python3
from rocon_flip.nodes.command import generic_advertiser

raise SystemExit(generic_advertiser())
