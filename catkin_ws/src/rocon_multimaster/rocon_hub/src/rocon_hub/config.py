"""The hub's parameters and the Redis configuration derived from them."""

import re
from dataclasses import dataclass
from pathlib import Path

from rocon_hub.error import HubNodeError

_LOOPBACK = "127.0.0.1 -::1"
_EVERYWHERE = "* -::*"

SOCKET = "redis.sock"
"""The Unix socket in the server's directory, accessible only to this user's processes."""

ADMIN = "hub"
"""The Redis user with all permissions: the hub itself."""

LONGEST_VALUE = 4 << 20
"""Maximum size of a value on the hub [bytes]; a record with a thousand advertisements has 70,000."""

COMMANDS = (
    *("get", "set", "mget", "del", "pexpire", "sadd", "srem", "smembers", "sismember"),
    *(
        "hset",
        "hdel",
        "hmget",
        "hgetall",
        "publish",
        "subscribe",
        "unsubscribe",
        "watch",
        "unwatch",
        "multi",
        "exec",
    ),
    *("ping", "info", "time", "scan"),
)
"""The Redis commands that the protocol needs and gateways may use."""

_PATTERNS = (
    *("%R~rocon:hub:*", "~rocon:gateway:*", "~rocon:alive:*", "~rocon:requests:*", "~rocon:lost:*"),
    *("~rocon:kept:*", "~rocon:gateways", "~rocon:namespaces"),
    *(
        "&rocon:gateways",
        "&rocon:gateway:*",
        "&rocon:requests:*",
        "&rocon:examine",
        "&rocon:examined:*",
    ),
)
"""Keys and channels for gateways in the syntax of Redis ACLs; those of the hub itself are read-only."""


@dataclass(frozen=True)
class HubConfig:
    """Parameters of the node `hub`."""

    name: str = "Gateway Hub"  #: the hub's name as shown to gateways
    port: int = 6380  #: TCP port of the hub's own Redis
    zeroconf: bool = True  #: whether to announce the hub by mDNS
    #: memory limit of Redis for data and connections, in Redis' notation. A thousand gateways that reconnect at once
    #: need 80 MB for a moment, more if they read slowly.
    max_memory: str = "256mb"
    gateway_gone_timeout: float = (
        300.0  #: time after which the record of a silent gateway is deleted [s]
    )
    watcher_thread_rate: float = 0.2  #: how often to check for such records [Hz]
    password_file: str = ""  #: file with the hub's password; empty: use the environment, or none
    #: directory with the fleet's certificates; only clients with one can then connect. Empty: use the environment, or
    #: no TLS.
    tls_directory: str = ""
    insecure: bool = False  #: accept all clients on the network without a password

    def __post_init__(self) -> None:
        """Raises HubNodeError for invalid parameter values."""
        if not self.name.strip() or not self.name.isprintable():
            raise HubNodeError(f"hub: ~name must be a printable text, not {self.name!r}")
        if not 0 < self.port < 65536:
            raise HubNodeError(f"hub: ~port must be 1 to 65535, not {self.port}")
        if not re.fullmatch(r"\d+(b|kb?|mb?|gb?)?", self.max_memory.lower()):
            raise HubNodeError(
                f"hub: ~max_memory must be a size such as 64mb, not {self.max_memory!r}"
            )
        if self.gateway_gone_timeout <= 0 or self.watcher_thread_rate <= 0:
            raise HubNodeError(
                "hub: ~gateway_gone_timeout and ~watcher_thread_rate must be greater than 0"
            )

    @property
    def directory_name(self) -> str:
        """Name of the directory for configuration and log. It contains the port, for several hubs on one machine."""
        return re.sub(r"[^a-z0-9]+", "_", self.name.lower()).strip("_") + f"_{self.port}"


@dataclass(frozen=True)
class Guard:
    """Authentication settings that keep unauthenticated clients off the hub."""

    #: whether clients must prove that they know a password. Redis then has no port; they connect to the hub's `Front`.
    has_password: bool = False
    certificate: str = ""  #: file of our certificate; empty for no TLS. Clients then need one of the same authority.
    key: str = ""  #: file of its key
    authority: str = ""  #: file of the authority's certificate


def is_open(config: HubConfig, guard: Guard) -> bool:
    """Returns whether other machines may connect: with password or certificate, or if configured as insecure."""
    return guard.has_password or bool(guard.certificate) or config.insecure


def redis_configuration(
    config: HubConfig, directory: Path, guard: Guard, admin_password: str
) -> str:
    """Returns the text of a redis.conf for a private server that stores nothing on disk.

    Args:
        config: the hub's parameters.
        directory: directory of the server's Unix socket `SOCKET`.
        guard: authentication of gateways.
        admin_password: password of the user `ADMIN`.
    """
    lines = [
        f"bind {_EVERYWHERE if is_open(config, guard) else _LOOPBACK}",
        f"protected-mode {'no' if is_open(config, guard) else 'yes'}",
        *_ports(config, guard),
        "daemonize no",
        "supervised no",
        "databases 1",
        'save ""',
        "appendonly no",
        f"maxmemory {config.max_memory}",
        "maxmemory-policy noeviction",
        f"dir {quoted(str(directory))}",
        f"unixsocket {SOCKET}",
        "unixsocketperm 600",
        'logfile ""',
        "tcp-keepalive 10",
        # Reading a longer record would delay the heartbeats of every gateway.
        f"proto-max-bulk-len {LONGEST_VALUE}",
        "client-output-buffer-limit pubsub 8mb 2mb 30",
        f"user {ADMIN} reset on {quoted('>' + admin_password)} ~* &* +@all",
        f"user default reset on nopass {' '.join(_PATTERNS)} {' '.join(f'+{one}' for one in COMMANDS)}",
    ]
    return "\n".join(lines) + "\n"


def _ports(config: HubConfig, guard: Guard) -> list[str]:
    if guard.has_password:
        return ["port 0"]
    if not guard.certificate:
        return [f"port {config.port}"]
    return [
        "port 0",
        f"tls-port {config.port}",
        f"tls-cert-file {quoted(guard.certificate)}",
        f"tls-key-file {quoted(guard.key)}",
        f"tls-ca-cert-file {quoted(guard.authority)}",
        "tls-auth-clients yes",
        "tls-protocols TLSv1.3",
        "tls-session-caching no",
    ]


def quoted(text: str) -> str:
    """Returns `text` as one argument of a redis.conf line."""
    body = "".join(
        c if c.isascii() and c.isprintable() and c not in '"\\' else _escaped(c) for c in text
    )
    return f'"{body}"'


def _escaped(character: str) -> str:
    return "".join(f"\\x{byte:02x}" for byte in character.encode())
