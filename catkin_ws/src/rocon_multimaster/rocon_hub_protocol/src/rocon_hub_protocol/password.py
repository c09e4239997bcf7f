"""Reads the hub's password from a file or the environment, never from a command line or ROS parameter."""

import logging
import os
from collections.abc import Callable, Mapping
from pathlib import Path

from rocon_hub_protocol.code import Code, HubError

FILE_VARIABLE = "ROCON_HUB_PASSWORD_FILE"
VARIABLE = "ROCON_HUB_PASSWORD"

Password = Callable[[], str]
"""Returns the current password."""


class PasswordFile:
    """The first line of a file, read again when the file changes. May be called from any thread.

    If the changed file is unreadable or empty, this is logged once and the old password stays in use.

    Raises:
        HubError: 14, if the file is initially unreadable or empty.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._logger = logging.getLogger("rosout")
        self._said = ""
        try:
            self._read = self._stamp()
            self._password = _first_line(path)
        except (OSError, ValueError) as error:
            raise HubError(
                Code.HUB_CONNECTION_FAILED, f"the hub's password file cannot be used: {error}"
            ) from None

    def __call__(self) -> str:
        """Returns the password."""
        try:
            stamp = self._stamp()
            if stamp != self._read:
                self._read, self._password = stamp, _first_line(self._path)
                self._said = ""
                self._logger.info(
                    "the hub's password file has changed; its new password holds from now on"
                )
        except (OSError, ValueError) as error:
            self._complain(
                f"the hub's password file cannot be used any more, keeping its last password: {error}"
            )
        return self._password

    def _complain(self, text: str) -> None:
        if text != self._said:
            self._said = text
            self._logger.error("%s", text)

    def _stamp(self) -> tuple[int, ...]:
        # Follows symbolic links, because container runtimes update a file by replacing the link.
        now = self._path.stat()
        return now.st_dev, now.st_ino, now.st_size, now.st_mtime_ns


def password_from(path: str, environment: Mapping[str, str] = os.environ) -> Password | None:
    """Returns the password from the file `path`, else the file named in the environment, else the environment itself.

    Returns None if none of these is set.

    Raises:
        HubError: 14, if the configured file is unreadable or empty.
    """
    path = path or environment.get(FILE_VARIABLE, "")
    if path:
        return PasswordFile(Path(path).expanduser())
    password = environment.get(VARIABLE)
    return None if not password else lambda: str(password)


def _first_line(path: Path) -> str:
    lines = path.read_text().splitlines()
    if not lines or not lines[0].strip():
        raise ValueError(f"{path} has no password in its first line")
    return lines[0].strip()
