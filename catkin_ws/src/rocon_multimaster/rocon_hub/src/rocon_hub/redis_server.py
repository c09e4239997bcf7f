"""A private redis-server process: starts, checks and stops it, and never leaves it behind."""

import contextlib
import os
import secrets
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import redis

from rocon_hub.config import ADMIN, SOCKET, Guard, HubConfig, is_open, redis_configuration
from rocon_hub.error import PortBusyError, RedisError
from rocon_hub.front import Front
from rocon_hub.salt import SaltFile
from rocon_hub_protocol.redis_client import TIMEOUT, Access
from tcpros.tls import AUTHORITY, CERTIFICATE, KEY

START_TIMEOUT = 10.0
"""Timeout for a new server to answer [s]."""


def guard_from(access: Access) -> Guard:
    """Returns the authentication settings of Redis that admit only clients with this access."""
    if access.certificates is None:
        return Guard(access.password is not None)
    files = (str(access.certificates.directory / name) for name in (CERTIFICATE, KEY, AUTHORITY))
    return Guard(access.password is not None, *files)


class SocketConnection(redis.UnixDomainSocketConnection):
    """A connection over a Unix socket. The one in redis-py leaks its socket if connecting fails."""

    def _connect(self) -> socket.socket:
        sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            sock.settimeout(self.socket_timeout)
            sock.connect(self.path)
        except OSError:
            sock.close()
            raise
        return sock


class RedisServer:
    """One process. Start it from the program's main thread, because it dies with the thread that started it.

    Args:
        config: the hub's parameters.
        directory: for configuration, log and socket; created if absent, accessible to this user only.
        access: the credentials that gateways need.
    """

    def __init__(self, config: HubConfig, directory: Path, access: Access) -> None:
        self._config = config
        self._directory = directory
        self._access = access
        self._guard = guard_from(access)
        self._front: Front | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._admin_password = secrets.token_hex(32)
        self._users: list[str] = []
        self._salts = SaltFile(directory / "salt")
        self._salt = self._salted = ""
        self.log = directory / "redis-server.log"  #: file with the server's output
        directory.mkdir(parents=True, exist_ok=True)
        directory.chmod(0o700)
        # The path of a Unix socket is limited to 107 bytes, which the directory may exceed. This path is short.
        self._folder = os.open(directory, os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
        self._socket = f"/proc/self/fd/{self._folder}/{SOCKET}"
        pool = redis.ConnectionPool(
            connection_class=SocketConnection,
            path=self._socket,
            username=ADMIN,
            password=self._admin_password,
            socket_timeout=TIMEOUT,
            decode_responses=True,
            # Keeps gateway names that are not valid UTF-8, so that these gateways are removed like others.
            encoding_errors="surrogateescape",
        )
        self.client = redis.Redis(
            connection_pool=pool
        )  #: client of the user with all permissions, over the socket

    def salt(self) -> str:
        """Returns the fleet's salt, empty without a password.

        It is kept in the directory, so restarts do not change it. A new password brings a new salt: who knew the old
        password also knew the old salt.
        """
        if self._access.password is None:
            return ""
        password = self._access.password()
        if password != self._salted:
            self._salt, self._salted = self._salts.get(password), password
        return self._salt

    @property
    def pid(self) -> int | None:
        """The server's process id; None if it is not running."""
        return self._process.pid if self._process and self._process.poll() is None else None

    def start(self) -> None:
        """Starts the server and waits until it answers.

        Raises:
            PortBusyError: the port is in use.
            RedisError: redis-server is not installed or does not start.
        """
        executable = shutil.which("redis-server")
        if executable is None:
            raise RedisError(
                "hub: there is no redis-server on the PATH; install the package redis-server"
            )
        self._check_port()
        configuration = self._write_configuration()
        with self.log.open("ab") as log:
            # setpriv makes the kernel kill the server when this process dies, for any reason.
            self._process = subprocess.Popen(
                ["setpriv", "--pdeathsig", "KILL", "--", executable, str(configuration)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._await()
        if self._access.password:
            context = self._access.certificates.server if self._access.certificates else None
            try:
                self._front = Front(self._config.port, self._socket, self._access.password, context)
            except OSError as error:
                raise self._port_busy(error) from None

    def _check_port(self) -> None:
        address = "" if is_open(self._config, self._guard) else "127.0.0.1"
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((address, self._config.port))
            except OSError as error:
                raise self._port_busy(error) from None

    def _port_busy(self, error: OSError) -> PortBusyError:
        text = f"hub: port {self._config.port} is in use ({error.strerror}): another hub or Redis runs there"
        return PortBusyError(f"{text}. End it, or set hub_port")

    def _write_configuration(self) -> Path:
        path = self._directory / "redis.conf"
        path.touch(mode=0o600)
        path.write_text(
            redis_configuration(self._config, self._directory, self._guard, self._admin_password)
        )
        return path

    def _await(self) -> None:
        deadline = time.monotonic() + START_TIMEOUT
        assert self._process is not None
        while time.monotonic() < deadline:
            with contextlib.suppress(redis.ConnectionError, redis.TimeoutError):
                self._users = self.client.acl_list()
                return
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(0.02)
                raise RedisError(
                    f"hub: redis-server ended at once: {self._last_line()} (log: {self.log})"
                )
        self.stop()
        raise RedisError(
            f"hub: redis-server did not answer within {START_TIMEOUT:g} s (log: {self.log})"
        )

    def has_our_users(self) -> bool:
        """Returns whether Redis' users and permissions are unchanged since its start; raises redis.RedisError."""
        return bool(self.client.acl_list() == self._users)

    def _last_line(self) -> str:
        lines = self.log.read_text(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"

    def stop(self) -> None:
        """Closes the port and stops the server, first with SIGTERM; does nothing if it has ended."""
        process, self._process = self._process, None
        front, self._front = self._front, None
        if front:
            front.close()
        self.client.connection_pool.disconnect()
        if process is None or process.poll() is not None:
            return
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(2.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
