"""Files that ``./pioneer`` keeps: each fleet as a Compose project, and the secrets that all fleets share."""

import secrets
from pathlib import Path

from containers import ROOT
from containers.engine import ContainerError, Project, compose_command
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
        "PIONEER_HUB_PASSWORD_FILE": str(secret("hub-password")),
        "PIONEER_DESKTOP_TOKEN_FILE": str(secret("desktop-token")),
        "PIONEER_WEB_TOKEN_FILE": str(secret("web-token")),
    }
    return Project(name, tuple(compose_command()), written if written.is_file() else SHIPPED, {**files, **variables})


def secret(name: str) -> Path:
    """Returns the file with a secret: the hub's password, or a page's access token; creates it at the first call."""
    path = STATE / name
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch(mode=0o600)
        path.write_text(secrets.token_urlsafe(24) + "\n")
    return path


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
