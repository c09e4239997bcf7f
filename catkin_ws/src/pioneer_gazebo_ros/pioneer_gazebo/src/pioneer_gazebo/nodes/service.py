"""How a service of ``/gazebo`` is answered."""

from collections.abc import Callable
from typing import Any

import rospy

from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.nodes.mailbox import ClosedError, Mailbox

Handler = Callable[[Any], Any]

LONGEST = 400
"""Characters of a refusal: names that a client sends may have millions."""


def serve(mailbox: Mailbox, name: str, kind: Any, handler: Handler) -> None:
    """Serves ``/gazebo/NAME`` by ``handler``, which runs in the simulation's thread and returns a response.

    An invalid request is answered with ``success`` false and one line in ``status_message``, which is logged as well;
    a service whose response has no such field fails with that line.
    """

    def answer(request: Any) -> Any:
        try:
            return mailbox.call(lambda: handler(request))
        except (SimulatorError, ValueError, ClosedError) as error:
            return refusal(name, kind, str(error))

    rospy.Service(f"/gazebo/{name}", kind, answer)


def refusal(name: str, kind: Any, text: str) -> Any:
    """Returns the response to a request that failed, and logs why."""
    text = text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}"
    rospy.logerr("%s: %s", name, text)
    response = kind._response_class()
    field = "status_message" if hasattr(response, "status_message") else "message"
    if not hasattr(response, field):
        raise rospy.ServiceException(text)
    response.success = False
    setattr(response, field, text)
    return response
