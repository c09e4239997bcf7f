"""Files that ``./pioneer`` keeps: each fleet as a Compose project, and the secrets that all fleets share."""

import secrets
from pathlib import Path

from containers import ROOT
from containers.engine import DESKTOP, WEB, ContainerError, Project, compose_command
from containers.swarm import Stack
from tcpros.adapters.authority import Authority
from tcpros.adapters.tls import CERTIFICATE
from tcpros.core.error import CertificateError

SHIPPED = ROOT / "docker" / "compose.yaml"
STATE = ROOT / ".setup" / "containers"
BASE = "aadiworkstation"


def written_compose(name: str) -> Path:
    """Returns the path of the project's compose file; the file exists once a fleet was started."""
    return STATE / name / "compose.yaml"


def stack(name: str) -> Stack:
    """Returns the fleet as a stack of the swarm; its file exists once it was deployed."""
    return Stack(name, STATE / name / "stack.yaml")


def fleet(name: str, **variables: str) -> Project | Stack:
    """Returns the fleet of that name; as a stack if it was started on the swarm.

    Raises:
        ContainerError: no engine answers.
    """
    return stack(name) if stack(name).file.is_file() else project(name, **variables)


def project(name: str, **variables: str) -> Project:
    """Returns the project with its file; the shipped one if no fleet was started yet.

    Raises:
        ContainerError: no engine answers.
    """
    written = written_compose(name)
    files = {
        "PIONEER_HUB_PASSWORD_FILE": str(hub_password()),
        "PIONEER_DESKTOP_TOKEN_FILE": str(token(DESKTOP)),
        "PIONEER_WEB_TOKEN_FILE": str(token(WEB)),
    }
    return Project(name, tuple(compose_command()), written if written.is_file() else SHIPPED, {**files, **variables})


def hub_password() -> Path:
    """Returns the file with the hub's password; creates it at the first call."""
    return _secret(STATE / "hub-password")


def token(extra: str) -> Path:
    """Returns the file with the access token of the desktop or the fleet page; creates it at the first call."""
    return _secret(STATE / f"{extra}-token")


def certificates() -> Path:
    """Returns the directory with the certificate shared by all computers of a stack; creates it at the first call.

    Raises:
        ContainerError: openssl is missing.
    """
    folder = STATE / "tls" / "fleet"
    if not (folder / CERTIFICATE).exists():
        try:
            Authority(folder.parent).certify(folder.name)
        except CertificateError as error:
            raise ContainerError(str(error)) from None
    return folder


def _secret(path: Path) -> Path:
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(mode=0o600)
        path.write_text(secrets.token_urlsafe(24) + "\n")
    return path
