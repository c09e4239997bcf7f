"""Runs nodes without rospy (`NodeHandle`), one or several per process, like nodelets in C++.

``node_host NAME=MODULE …`` runs one node per name, created by the module's ``build``. Remappings apply to all nodes.
Private parameters are in each node's namespace. The process ends with its last node, with status 1 if a node cannot be
created.
"""

import importlib
import logging
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

import rosgraph

from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.adapters.node_process import Build, NodeProcess
from pioneer_node.core.ring import MEMBERS, membership


def run(name: str, build: Build) -> NoReturn:
    """Runs a single node and then ends the process.

    Args:
        name: the node's default name.
        build: creates the object that does its work. A ParameterError is logged in one line; exit status 1.
    """
    process = NodeProcess(sys.argv)
    if not process.add(process.own_name(name), build, join_ring):
        process.fail()
    leave(process.run())


def join_ring(handle: NodeHandle) -> None:
    """Puts a node into lockstep if its launch file makes it a member of a ring (`core.ring.MEMBERS`)."""
    if MEMBERS not in os.environ:
        return
    from pioneer_node.adapters.handle_lockstep import HandleMember

    ring, members, name = membership(handle.name, rosgraph.names.namespace(handle.name), os.environ)
    if members:
        HandleMember(handle, ring, members, name)


def leave(status: int) -> NoReturn:
    """Exits without interpreter finalization."""
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the nodes given on the command line."""
    words = list(sys.argv if argv is None else argv)
    pairs = [word.partition("=")[::2] for word in rosgraph.myargv(words)[1:]]
    if not pairs or not all(name and module for name, module in pairs):
        sys.stderr.write(
            "usage: node_host NAME=MODULE …, where NAME is a node and MODULE builds it\n"
        )
        return 2
    process = NodeProcess(words)
    if not all(
        process.add(name, importlib.import_module(module).build, join_ring)
        for name, module in pairs
    ):
        process.fail()
    leave(process.run())
