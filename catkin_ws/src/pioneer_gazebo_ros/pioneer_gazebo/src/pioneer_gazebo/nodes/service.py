"""Serves the services of ``/gazebo``."""

from collections.abc import Callable
from typing import Any

import rospy

from pioneer_gazebo.core.error import SimulatorError
from pioneer_gazebo.nodes.mailbox import ClosedError, Mailbox

LONGEST = 400
"""Maximum length of an error text [characters]; names sent by clients may have millions."""


def serve(name: str, kind: Any, handler: Callable[[Any], Any], mailbox: Mailbox | None = None) -> None:
    """Serves ``/gazebo/NAME`` with ``handler``, in the thread of ``mailbox`` or, without one, in the service's own.

    The handler returns a response, the text of an otherwise default response, or None; ``success`` and "ok" are filled
    in. For an invalid request, ``success`` is false and ``status_message`` has one line, which is also logged; if the
    response type has no such field, the call fails with that line.
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
    """Returns the response with its success and text fields set, if it has them; keeps an existing text.

    Raises:
        rospy.ServiceException: the request failed and the response has no such fields.
    """
    for field in ("status_message", "message"):
        if hasattr(response, field):
            response.success = success
            setattr(response, field, getattr(response, field) or text)
            return response
    if not success:
        raise rospy.ServiceException(text)
    return response
