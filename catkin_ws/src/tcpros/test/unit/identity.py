"""Certificates for the tests of this package and of those that use it."""

import pytest

from tcpros.authority import Authority
from tcpros.tls import certificates_from


class Identities:
    """Certificates, created on first use by the authority of a given fleet."""

    def __init__(self, folder):
        self._folder = folder
        self._made = {}

    def directory(self, name="robot", fleet="ours", days=30):
        """Returns a machine's directory; negative `days` make an expired certificate, which needs a name of its own."""
        made, directory = self._made.get((name, fleet), (days, None))
        assert made == days, (
            f"{name} of {fleet} has a certificate of {made} days already; use another name"
        )
        if directory is None:
            directory = Authority(self._folder / fleet, days).certify(name)
            self._made[name, fleet] = days, directory
        return directory

    def __call__(self, *arguments, **settings):
        return certificates_from(str(self.directory(*arguments, **settings)))


@pytest.fixture(scope="session")
def identities(tmp_path_factory):
    return Identities(tmp_path_factory.mktemp("identities"))
