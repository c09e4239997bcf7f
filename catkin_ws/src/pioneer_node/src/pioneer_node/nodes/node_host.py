"""Runs nodes without rospy (`NodeHandle`): one in a process of its own, or several in one, as nodelets do for C++.

``node_host NAME=MODULE …`` runs a node of each name; the module's ``build`` makes it. Remappings hold for all. Private
parameters are below each node's name. The process ends with its last node, with status 1 if one cannot be made.
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
    """Runs the one node of this process; ends the process.

    Args:
        name: the node's default name.
        build: makes the object that does its work. It raises ParameterError for bad parameters: one line, status 1.
    """
    process = NodeProcess(sys.argv)
    if not process.add(process.own_name(name), build, join_ring):
        process.fail()
    leave(process.run())


def join_ring(handle: NodeHandle) -> None:
    """Has a node keep in lockstep where its launch file makes it a member of a ring (`core.ring.MEMBERS`)."""
    if MEMBERS not in os.environ:
        return
    from pioneer_node.adapters.handle_lockstep import HandleMember

    ring, members, name = membership(handle.name, rosgraph.names.namespace(handle.name), os.environ)
    if members:
        HandleMember(handle, ring, members, name)


def leave(status: int) -> NoReturn:
    """Ends the process without taking Python's modules apart."""
    logging.shutdown()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the nodes that the command line names."""
    words = list(sys.argv if argv is None else argv)
    pairs = [word.partition("=")[::2] for word in rosgraph.myargv(words)[1:]]
    if not pairs or not all(name and module for name, module in pairs):
        sys.stderr.write("usage: node_host NAME=MODULE …, each a node's name and the module that makes it\n")
        return 2
    process = NodeProcess(words)
    if not all(process.add(name, importlib.import_module(module).build, join_ring) for name, module in pairs):
        process.fail()
    leave(process.run())
