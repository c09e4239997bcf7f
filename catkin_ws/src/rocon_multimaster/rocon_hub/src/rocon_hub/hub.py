"""The node `hub`."""

import threading
import time
from pathlib import Path

import redis
import rospkg
import rospy

from pioneer_node.core.parameter import config_from_mapping
from pioneer_node.nodes import entry
from rocon_hub.announcement import Announcement
from rocon_hub.config import HubConfig, is_open
from rocon_hub.error import AnnouncementError, HubNodeError, RedisError
from rocon_hub.redis_server import RedisServer, guard_from
from rocon_hub.registry import Registry
from rocon_hub_protocol.code import HubProtocolError
from rocon_hub_protocol.password import password_from
from rocon_hub_protocol.redis_client import OPEN, Access
from tcpros.descriptor import raise_limit
from tcpros.error import CertificateError
from tcpros.tls import certificates_from

LOOK_PERIOD = 0.25
"""Period of the check which gateways are alive [s]."""

SHORT_LIFE = 5.0
"""A Redis that dies sooner than this after its start counts as a failure [s]."""

ANNOUNCEMENT_PERIOD = 5.0
"""Period of the check whether this machine's announced addresses have changed [s]."""

UNANSWERED = 7
"""Number of consecutive timeouts, `redis_client.TIMEOUT` each, after which Redis is restarted."""

FAILURES = 3
"""Number of consecutive failures that ends the hub."""


class HubNode:
    """Starts a private redis-server, supervises it, and maintains its list of gateways.

    Subscribes: nothing. Publishes: nothing. Services: none; gateways connect to Redis.

    Parameters: the fields of `HubConfig`, private.

    Threads: only the main thread, apart from those of rospy, the mDNS announcement and, with a password, `Front`.

    On error: a port in use, a missing redis-server or an unreadable password file end the node with one line. If Redis
    dies, stops answering or has users that the hub did not create, it is restarted and gateways register again. A full
    Redis or a failed announcement is logged once.
    """

    def __init__(self) -> None:
        self._config = config_from_mapping(HubConfig, entry.parameters(), rospy.get_name())
        access = Access(
            password_from(self._config.password_file), certificates_from(self._config.tls_directory)
        )
        directory = Path(rospkg.get_ros_home()) / "redis" / self._config.directory_name
        self._server = RedisServer(self._config, directory, access)
        self._registry = Registry(
            self._server.client, self._config.gateway_gone_timeout, self._server.salt
        )
        self._stop = threading.Event()
        rospy.on_shutdown(self._stop.set)
        self._open = is_open(self._config, guard_from(access))
        tls = access.certificates is not None
        self._announcement = Announcement(self._config.name, self._config.port, self._open, tls)
        self._unannounced = ""
        self._failures = 0
        self._started, self._unanswered = 0.0, 0
        self._complaint = ""
        self._next_clear = 0.0
        self._warn(access)

    def _warn(self, access: Access) -> None:
        fault = access.certificates.fault() if access.certificates else ""
        if fault:
            rospy.logerr("no gateway accepts our certificate (%s)", fault)
        if self._config.insecure and access == OPEN:
            rospy.logwarn(
                "INSECURE: anybody on the network can connect to this hub and through it to every gateway. "
                "Use it on a network of your own only, or set a password"
            )
        elif not self._open:
            rospy.logwarn(
                "neither password nor certificate is set, so only this machine can reach the hub. For robots on other "
                "machines set ROCON_HUB_PASSWORD_FILE or ROCON_TLS_DIRECTORY here and there, or hub_insecure:=true here"
            )

    def spin(self) -> None:
        """Runs until shutdown, then stops Redis."""
        try:
            self._start()
            self._watch()
        finally:
            self._server.stop()
            self._announcement.close()

    def _start(self) -> None:
        self._server.start()
        self._started, self._unanswered = time.monotonic(), 0
        try:
            self._registry.open(self._config.name)
        except redis.ResponseError as error:
            text = f"hub: redis-server does not take the hub's name ({error}); is ~max_memory too small?"
            raise RedisError(text) from None
        rospy.loginfo(
            "hub '%s' on port %d (redis-server %d)",
            self._config.name,
            self._config.port,
            self._server.pid,
        )

    def _watch(self) -> None:
        next_announcement = 0.0
        while not self._stop.wait(LOOK_PERIOD):
            if self._config.zeroconf and time.monotonic() >= next_announcement:
                self._announce()
                next_announcement = time.monotonic() + ANNOUNCEMENT_PERIOD
            try:
                self._check()
                self._look()
                self._unanswered = 0
            except redis.ConnectionError:
                continue  # Redis has died or is about to; this is logged at the restart
            except redis.RedisError as error:
                self._unanswered = (
                    self._unanswered + 1 if isinstance(error, redis.TimeoutError) else 0
                )
                self._complain(error)

    def _check(self) -> None:
        """Restarts Redis if it has died, does not answer, or has users that we did not create."""
        if self._server.pid is None:
            self._restart("died")
        elif self._unanswered >= UNANSWERED:
            self._restart(f"has not answered {UNANSWERED} times in a row")
        elif not self._server.has_our_users():
            self._restart("has users or permissions that this hub did not set")

    def _look(self) -> None:
        for name in self._registry.look(time.monotonic()):
            rospy.logwarn("gateway %r is not heard of any more", name)
        for name in sorted(self._registry.returned):
            rospy.loginfo("gateway %r is heard of again", name)
        if time.monotonic() < self._next_clear:
            return
        self._next_clear = time.monotonic() + 1.0 / self._config.watcher_thread_rate
        for name in self._registry.clear(time.monotonic()):
            rospy.loginfo("gateway %r removed", name)
        self._registry.write()
        if self._complaint:
            self._complaint = ""
            rospy.logwarn("redis-server works again")

    def _complain(self, error: redis.RedisError) -> None:
        """Logs an error of our Redis: once, until it changes or is resolved."""
        complaint = f"redis-server: {error}"
        if "OOM command not allowed" in str(error):
            limit = self._config.max_memory
            complaint = f"redis-server is full ({limit}), so gateways cannot join or change rules: raise ~max_memory"
        if complaint != self._complaint:
            rospy.logerr("%s", complaint)
        self._complaint = complaint

    def _announce(self) -> None:
        try:
            self._announcement.refresh()
            if self._unannounced:
                rospy.loginfo("announced by mDNS")
            self._unannounced = ""
        except AnnouncementError as error:
            if str(error) != self._unannounced:
                rospy.logwarn("%s; gateways need gateway_hub_uri", error)
            self._unannounced = str(error)

    def _restart(self, why: str) -> None:
        self._failures = self._failures + 1 if time.monotonic() - self._started < SHORT_LIFE else 1
        if self._failures >= FAILURES:
            raise RedisError(
                f"hub: redis-server failed {self._failures} times in a row (log: {self._server.log})"
            )
        rospy.logerr("redis-server %s; starting it again (log: %s)", why, self._server.log)
        self._server.stop()
        self._next_clear = 0.0
        self._start()


def main() -> int:
    """Entry point of the executables `hub` and `hub.py`."""
    raise_limit()
    return entry.run("hub", HubNode, (HubNodeError, HubProtocolError, CertificateError))
