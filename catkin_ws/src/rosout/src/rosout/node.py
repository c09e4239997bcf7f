"""The node `rosout`: collects the log messages of all nodes, in place of ROS' own."""

import os
import time
from functools import partial
from pathlib import Path
from typing import NoReturn

import rospkg
from rosgraph_msgs.msg import Log

from pioneer_node.adapters.node_handle import NodeHandle
from pioneer_node.nodes.node_host import run
from rosout.line import line_of
from rosout.log_file import LogFile

NAME = "rosout"
NO_FILE = "ROSOUT_DISABLE_FILE_LOGGING"
"""Environment variable that switches the file off."""


class RosoutNode:
    """Writes the messages of ``/rosout`` to a file and passes them on to ``/rosout_agg``.

    Parameters: ``~omit_topics``, whether to leave out the topics of the node that logged a message.
    On error: a message that is not a Log is dropped, a file that cannot be written left alone; each with one line.
    """

    def __init__(self, node: NodeHandle) -> None:
        self._node = node
        self._with_topics = not node.parameter("~omit_topics", False)
        self._file: LogFile | None = None
        if not os.environ.get(NO_FILE):
            path = Path(rospkg.get_log_dir()) / "rosout.log"
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = LogFile(path, partial(node.logger.error, "%s"))
            self._file.write(f"\n\n{time.time():.9f}  Node Startup\n")
        self._all = node.advertise("/rosout_agg", Log)
        node.subscribe("/rosout", Log, self._take)

    def _take(self, message: Log, _sender: str) -> None:
        self._all.publish(message)
        if self._file:
            self._file.write(line_of(message, self._with_topics))


def main() -> NoReturn:
    """Runs the node."""
    run(NAME, RosoutNode)
