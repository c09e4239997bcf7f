"""What ``./pioneer`` keeps on disk: each fleet as a Compose project, and the secrets that all share."""

import secrets
from pathlib import Path

from containers import ROOT
from containers.engine import Project, compose_command

SHIPPED = ROOT / "docker" / "compose.yaml"
STATE = ROOT / ".setup" / "containers"
BASE = "aadiworkstation"


def written_compose(name: str) -> Path:
    """Returns where the compose file of the project of that name is, once a fleet was started."""
    return STATE / name / "compose.yaml"


def project(name: str, **variables: str) -> Project:
    """Returns the project as it stands on disk; the shipped file where no fleet was started yet.

    Raises:
        ContainerError: no engine answers.
    """
    written = written_compose(name)
    files = {"PIONEER_HUB_PASSWORD_FILE": str(hub_password()), "PIONEER_DESKTOP_TOKEN_FILE": str(desktop_token())}
    return Project(name, tuple(compose_command()), written if written.is_file() else SHIPPED, {**files, **variables})


def hub_password() -> Path:
    """Returns the file with the hub's password, which is made at the first call."""
    return _secret(STATE / "hub-password")


def desktop_token() -> Path:
    """Returns the file with the word that opens the desktop, which is made at the first call."""
    return _secret(STATE / "desktop-token")


def _secret(path: Path) -> Path:
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(mode=0o600)
        path.write_text(secrets.token_urlsafe(24) + "\n")
    return path
