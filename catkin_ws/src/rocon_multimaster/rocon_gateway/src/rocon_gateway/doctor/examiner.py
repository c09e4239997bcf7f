"""Answers the doctor's requests: examines this gateway's links in a separate thread and replies through the hub."""

import logging
import threading

import redis

from rocon_gateway.doctor.examination import is_request, text_from_examination
from rocon_gateway.hub.session import HubSession
from rocon_hub_protocol.key import examined_key

MAX_WAITING = 16
"""Maximum number of requests waiting for an examination; further ones are not answered."""

_LOGGER = logging.getLogger("rosout")


class Examiner:
    """Runs at most one examination per hub at a time; requests that arrive meanwhile share its result.

    Methods do not block and may be called from any thread.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: dict[HubSession, set[str]] = {}

    def asked(self, session: HubSession, request: str) -> None:
        """Handles a request received over `session`; ignores invalid ones."""
        if not is_request(request):
            return
        with self._lock:
            idle = session not in self._waiting
            waiting = self._waiting.setdefault(session, set())
            if len(waiting) < MAX_WAITING:
                waiting.add(request)
        if idle:
            thread = threading.Thread(
                target=self._look, args=(session,), name="examination", daemon=True
            )
            try:
                thread.start()
            except RuntimeError as error:  # no more threads on this machine
                _LOGGER.warning("no examination for the doctor: %s", error)
                with self._lock:
                    self._waiting.pop(session)

    def _look(self, session: HubSession) -> None:
        try:
            self._examine(session)
        except (redis.RedisError, OSError):
            pass  # the hub is lost, and the request with it
        except Exception:  # top level of this thread: any exception here is a bug
            _LOGGER.critical("internal error in an examination; it is not answered", exc_info=True)

    def _examine(self, session: HubSession) -> None:
        # Imported on first use.
        from rocon_gateway.doctor.facts import examination

        try:
            seen = text_from_examination(examination(session, session.name))
        finally:
            with self._lock:
                requests = self._waiting.pop(session)
        for request in requests:
            session.client.publish(examined_key(request), seen)
