"""The keys by which gateways that know the same password recognise one another on links."""

import hashlib
import threading
from collections.abc import Callable, Iterable

MOST_KEYS = 8
"""Keys of so many hubs are kept; those learnt last."""

_COST = {"n": 2**14, "r": 8, "p": 1, "dklen": 32}


class PasswordKeyring:
    """Implements `core.connection.Keyring`: one key for each salt that a hub gave us, derived once by scrypt.

    Args:
        password: returns the password as it is now.
    """

    def __init__(self, password: Callable[[], str]) -> None:
        self._password = password
        self._lock = threading.Lock()
        self._salts: tuple[str, ...] = ()
        self._keys: dict[str, bytes] = {}
        self._used = ""

    def learn(self, salt: str) -> None:
        """Adds the key of a hub's salt; takes some 50 ms of CPU time for a new one."""
        with self._lock:
            if salt and salt not in self._salts:
                self._salts = (salt, *self._salts)[:MOST_KEYS]
                self._derive()

    def refresh(self) -> None:
        """Derives all keys again if the password has changed; links that are up stay up."""
        with self._lock:
            if self._salts and self._password() != self._used:
                self._derive()

    def _derive(self) -> None:
        password = self._password()
        known = self._keys if password == self._used else {}
        self._used = password
        # Readers see the old or the new keys, never a half of each.
        self._keys = {key_name(one): known.get(key_name(one)) or _key(password, one) for one in self._salts}

    def names(self) -> tuple[str, ...]:
        """Returns the names of the keys that are valid now."""
        return tuple(self._keys)

    def key(self, names: Iterable[str]) -> tuple[str, bytes] | None:
        """Returns the first of these keys that we have, with its name; None if we have none."""
        keys = self._keys
        return next(((name, keys[name]) for name in names if name in keys), None)


def key_name(salt: str) -> str:
    """Returns what names a key on links, from which its salt does not follow."""
    return hashlib.sha256(f"rocon link {salt}".encode()).hexdigest()[:16]


def _key(password: str, salt: str) -> bytes:
    return hashlib.scrypt(password.encode(), salt=salt.encode(), **_COST)
