"""Files that ``./pioneer`` keeps: each fleet as a Compose project, and the secrets that all fleets share."""

import os
import secrets
import tempfile
from pathlib import Path

from containers import ROOT
from containers.engine import ContainerError, Project, compose_command
from containers.layout import DEFAULT_SUBNET, SUBNET, subnet_of
from containers.swarm import Stack
from tcpros.authority import Authority
from tcpros.error import CertificateError
from tcpros.tls import CERTIFICATE

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
    given = {SUBNET: subnet(name), **files, **variables}
    file = written if written.is_file() else SHIPPED
    return Project(name, tuple(compose_command()), file, given, written.with_name("lock"))


def secret(name: str) -> Path:
    """Returns the file with a secret: the hub's password, or a page's access token; creates it at the first call."""
    path = STATE / name
    # Empty if a full disk or a signal ended an earlier release's call: an empty password would stay for ever.
    if not path.is_file() or not path.read_text().strip():
        write_whole(path, secrets.token_urlsafe(24) + "\n")
    return path


def write_whole(path: Path, text: str) -> None:
    """Writes a file that only its owner can read: whole, or not at all. Creates its folder.

    Raises:
        ContainerError: it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.") as folder:
            part = Path(folder, path.name)
            part.touch(mode=0o600)
            part.write_text(text)
            os.replace(part, path)
    except OSError as error:
        raise ContainerError(f"cannot write {path}: {error.strerror}") from None


def subnet(name: str) -> str:
    """Returns the first three numbers of the fleet's addresses: PIONEER_SUBNET, else those it was started with."""
    return os.environ.get(SUBNET) or written_subnet(name) or DEFAULT_SUBNET


def written_subnet(name: str) -> str:
    """Returns the subnet that the fleet was last started in; empty if it never was."""
    file = written_compose(name)
    return subnet_of(file.read_text()) if file.is_file() else ""


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
