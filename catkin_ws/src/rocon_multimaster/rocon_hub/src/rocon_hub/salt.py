"""The file with the fleet's salt, from which gateways and the password derive the keys of their links."""

import hashlib
import hmac
import logging
import secrets
from pathlib import Path

_COST = {"n": 2**14, "r": 8, "p": 1, "dklen": 16}


class SaltFile:
    """A salt, and a check value that tells whether it was made for the current password.

    Testing a password against the check value takes 50 ms, and the file is readable by its account only.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def get(self, password: str) -> str:
        """Returns the salt for this password: the stored one, or a new one if the password has changed."""
        words = self._words()
        if len(words) == 2 and hmac.compare_digest(words[1], _check(password, words[0])):
            return words[0]
        salt = secrets.token_hex(32)
        try:
            self._path.touch(mode=0o600)
            self._path.write_text(f"{salt} {_check(password, salt)}\n")
        except OSError as error:
            logging.getLogger("rosout").warning(
                "the salt cannot be stored (%s): the hub has another one after a restart", error
            )
        return salt

    def _words(self) -> list[str]:
        try:
            return self._path.read_text(errors="replace").split()
        except OSError:
            return []


def _check(password: str, salt: str) -> str:
    return hashlib.scrypt(password.encode(), salt=f"check {salt}".encode(), **_COST).hex()
