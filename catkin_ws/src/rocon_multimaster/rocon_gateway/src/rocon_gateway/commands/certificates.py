"""The command `make_certificates`: an authority for a fleet, and for each machine a directory to copy there."""

import argparse
import sys
from pathlib import Path

from tcpros.authority import AUTHORITY_KEY, DAYS, Authority
from tcpros.error import CertificateError
from tcpros.tls import VARIABLE


def main() -> int:
    """Entry point of `make_certificates`; the exit status is 0, or 1 with one error line."""
    parser = argparse.ArgumentParser("make_certificates", description=__doc__)
    parser.add_argument(
        "directory", type=Path, help="folder of the authority; created if it does not exist"
    )
    parser.add_argument(
        "names",
        nargs="+",
        metavar="name",
        help="a machine; one that has a certificate gets a new one",
    )
    parser.add_argument(
        "--days",
        type=int,
        default=DAYS,
        help="how long certificates are good (default: %(default)s)",
    )
    options = parser.parse_args()
    authority = Authority(options.directory.expanduser(), options.days)
    try:
        made = [authority.certify(name) for name in options.names]
    except CertificateError as error:
        sys.stderr.write(f"make_certificates: {error}\n")
        return 1
    for directory in made:
        sys.stdout.write(
            f"{directory}: copy it to {directory.name}, and there {VARIABLE}=ITS_PATH\n"
        )
    sys.stdout.write(
        f"{options.directory / AUTHORITY_KEY}: keep it private; anyone who has it can add members to the fleet\n"
    )
    return 0
