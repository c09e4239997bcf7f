"""How a service of ``/gazebo`` is answered."""

from collections.abc import Callable
from typing import Any

import rospy

from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.nodes.mailbox import ClosedError, Mailbox

LONGEST = 400
"""Characters of a refusal: names that a client sends may have millions."""


def serve(name: str, kind: Any, handler: Callable[[Any], Any], mailbox: Mailbox | None = None) -> None:
    """Serves ``/gazebo/NAME`` by ``handler``, in the thread that serves ``mailbox``, or in the service's own without.

    The handler returns a response, the text of one that has nothing else to tell, or nothing; ``success`` and "ok" are
    added. An invalid request is answered with ``success`` false and one line in ``status_message``, which is logged as
    well; a service whose response has no such field fails with that line.
    """

    def answer(request: Any) -> Any:
        try:
            found = handler(request) if mailbox is None else mailbox.call(lambda: handler(request))
        except (SimulatorError, ValueError, ClosedError) as error:
            text = str(error)
            text = text if len(text) <= LONGEST else f"{text[: LONGEST // 2]} … {text[-LONGEST // 2 :]}"
            rospy.logerr("%s: %s", name, text)
            return _stated(kind._response_class(), False, text)
        response = kind._response_class() if found is None or isinstance(found, str) else found
        return _stated(response, True, found if isinstance(found, str) else "ok")

    rospy.Service(f"/gazebo/{name}", kind, answer)


def _stated(response: Any, success: bool, text: str) -> Any:
    """Returns the response with its fields of success and text filled, where it has them and no text yet.

    Raises:
        rospy.ServiceException: it has none, and is to say that the request failed.
    """
    for field in ("status_message", "message"):
        if hasattr(response, field):
            response.success = success
            setattr(response, field, getattr(response, field) or text)
            return response
    if not success:
        raise rospy.ServiceException(text)
    return response
