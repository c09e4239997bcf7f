#!/usr/bin/env python3
from pioneer_node.nodes.patch import import_without_numpy

raise SystemExit(import_without_numpy("rocon_flip.nodes.command").run("generic_advertiser.py"))
