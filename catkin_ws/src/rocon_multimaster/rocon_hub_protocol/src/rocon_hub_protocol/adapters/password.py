"""The hub's password, from a file or the environment: never from a command line or a ROS parameter."""

import os
from collections.abc import Mapping
from pathlib import Path

from rocon_hub_protocol.core.code import Code, HubError

FILE_VARIABLE = "ROCON_HUB_PASSWORD_FILE"
VARIABLE = "ROCON_HUB_PASSWORD"


def password_from(path: str, environment: Mapping[str, str] = os.environ) -> str | None:
    """Returns the password: the first line of the file at `path`, else of the file that the environment names, else
    the environment's own; None where nothing is set.

    Raises:
        HubError: 14, for a file that is named but cannot be read or is empty.
    """
    path = path or environment.get(FILE_VARIABLE, "")
    if not path:
        return environment.get(VARIABLE) or None
    try:
        lines = Path(path).expanduser().read_text().splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise HubError(Code.HUB_CONNECTION_FAILED, f"the hub's password file cannot be read: {error}") from None
    if not lines or not lines[0].strip():
        text = f"the hub's password file {path} has no password in its first line"
        raise HubError(Code.HUB_CONNECTION_FAILED, text)
    return lines[0].strip()
