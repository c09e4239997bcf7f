"""Link keys: gateways that know the same password authenticate each other with them."""

import hashlib
import threading
from collections.abc import Callable, Iterable

MOST_KEYS = 8
"""Maximum number of hubs whose keys are kept; the newest stay."""

_COST = {"n": 2**14, "r": 8, "p": 1, "dklen": 32}


class PasswordKeyring:
    """Implements `core.connection.Keyring`: one key per hub salt, derived once with scrypt.

    Args:
        password: returns the current password.
    """

    def __init__(self, password: Callable[[], str]) -> None:
        self._password = password
        self._lock = threading.Lock()
        self._salts: tuple[str, ...] = ()
        self._keys: dict[str, bytes] = {}
        self._used = ""

    def learn(self, salt: str, former: str = "") -> None:
        """Adds the key for a hub's salt; a new one takes about 50 ms of CPU time.

        ``former`` is the salt that the hub replaced, if any. Its key is no longer used: a former member, who knows that
        salt but not the new password, could test passwords against proofs made with it.
        """
        with self._lock:
            kept = tuple(known for known in self._salts if known not in (former, salt))
            salts = ((salt,) if salt else ()) + kept
            if set(salts) != set(self._salts):
                self._salts = salts[:MOST_KEYS]
                self._derive()

    def refresh(self) -> None:
        """Derives all keys again if the password has changed; existing links stay up."""
        with self._lock:
            if self._salts and self._password() != self._used:
                self._derive()

    def _derive(self) -> None:
        password = self._password()
        known = self._keys if password == self._used else {}
        self._used = password
        # One assignment: readers see either the old or the new keys, never a mix.
        self._keys = {
            key_name(one): known.get(key_name(one)) or _key(password, one) for one in self._salts
        }

    def names(self) -> tuple[str, ...]:
        """Returns the names of the valid keys."""
        return tuple(self._keys)

    def key(self, names: Iterable[str]) -> tuple[str, bytes] | None:
        """Returns name and key of the first of these that we have; None if we have none."""
        keys = self._keys
        return next(((name, keys[name]) for name in names if name in keys), None)


def key_name(salt: str) -> str:
    """Returns the public name of a key, which does not reveal the salt."""
    return hashlib.sha256(f"rocon link {salt}".encode()).hexdigest()[:16]


def _key(password: str, salt: str) -> bytes:
    return hashlib.scrypt(password.encode(), salt=salt.encode(), **_COST)
