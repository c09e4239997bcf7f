"""A fleet's certificates: created in one step, readable only by their owner, and each error reported in one line."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tcpros.authority import Authority
from tcpros.error import CertificateError
from tcpros.tls import VARIABLE, certificates_from


def test_a_machine_gets_what_it_needs_and_nobody_else_may_read_a_key(tmp_path):
    directory = Authority(tmp_path / "fleet").certify("robot.lab-1")
    assert directory == tmp_path / "fleet" / "robot.lab-1"
    assert sorted(file.name for file in directory.iterdir()) == ["ca.crt", "tls.crt", "tls.key"]
    assert not [file for file in (tmp_path / "fleet").rglob("*.key") if file.stat().st_mode & 0o077]
    assert sorted(file.name for file in (tmp_path / "fleet").iterdir()) == [
        "ca.crt",
        "ca.key",
        "robot.lab-1",
    ]


def test_an_authority_is_made_once_and_a_new_certificate_each_time(tmp_path):
    first = Authority(tmp_path).certify("robot")
    before = {file.name: file.read_bytes() for file in first.iterdir()}
    again = Authority(tmp_path).certify("robot")
    after = {file.name: file.read_bytes() for file in again.iterdir()}
    assert {name for name in before if before[name] != after[name]} == {"tls.crt", "tls.key"}
    assert certificates_from(str(again)).fault() == ""


@pytest.mark.parametrize("name", ["", "..", "a/b", "-x", "a\nb", "a b", "x" * 65])
def test_a_name_that_is_none_of_a_machine_is_refused(tmp_path, name):
    with pytest.raises(CertificateError, match="no name for a machine"):
        Authority(tmp_path).certify(name)


def test_half_an_authority_is_not_made_whole(tmp_path):
    Authority(tmp_path).certify("robot")
    (tmp_path / "ca.key").unlink()
    with pytest.raises(CertificateError, match="only one of"):
        Authority(tmp_path).certify("robot2")


def test_an_authority_whose_making_was_killed_is_completed_with_its_key(tmp_path):
    """At that moment only the key exists; a certificate that was signed by it stays valid."""
    first = Authority(tmp_path).certify("robot")
    key = (tmp_path / "ca.key").read_bytes()
    (tmp_path / "ca.crt").unlink()
    second = Authority(tmp_path).certify("robot2")
    assert (tmp_path / "ca.key").read_bytes() == key
    for directory in (first, second):
        certificate = directory / "tls.crt"
        done = subprocess.run(
            ["openssl", "verify", "-CAfile", tmp_path / "ca.crt", certificate], check=False
        )
        assert done.returncode == 0


@pytest.mark.parametrize("replaced", range(3))
def test_a_machine_with_a_certificate_has_all_its_files_wherever_a_kill_came(
    tmp_path, monkeypatch, replaced
):
    """The command is killed after it has moved ``replaced`` of the machine's three files to their place."""
    authority = Authority(tmp_path)
    authority.certify("other")
    moved = []
    replace = Path.replace

    def kill_at(file, target):
        if len(moved) == replaced:
            raise KeyboardInterrupt
        moved.append(target)
        return replace(file, target)

    monkeypatch.setattr(Path, "replace", kill_at)
    with pytest.raises(KeyboardInterrupt):
        authority.certify("robot")
    assert len(moved) == replaced
    assert not (tmp_path / "robot" / "tls.crt").exists()


def test_nothing_is_said_where_nothing_is_asked(identities):
    assert certificates_from("", {}) is None
    assert certificates_from("", {VARIABLE: str(identities.directory())}) is not None


def broken(tmp_path, identities):
    return shutil.copytree(identities.directory(), tmp_path / "broken")


@pytest.mark.parametrize("name", ["tls.crt", "tls.key", "ca.crt"])
def test_a_file_that_is_missing_is_named(tmp_path, identities, name):
    (broken(tmp_path, identities) / name).unlink()
    with pytest.raises(CertificateError, match=f"broken cannot be used: .*/{name}: No such file"):
        certificates_from(str(tmp_path / "broken"))


@pytest.mark.parametrize("name", ["tls.crt", "tls.key", "ca.crt"])
def test_a_file_that_is_none_is_one_line(tmp_path, identities, name):
    (broken(tmp_path, identities) / name).write_text("nonsense\n")
    with pytest.raises(CertificateError) as caught:
        certificates_from(str(tmp_path / "broken"))
    assert "\n" not in str(caught.value)


def test_a_key_of_another_certificate_is_one_line(tmp_path, identities):
    shutil.copy(identities.directory("other") / "tls.key", broken(tmp_path, identities))
    with pytest.raises(CertificateError, match="key values mismatch"):
        certificates_from(str(tmp_path / "broken"))


def test_nobody_is_asked_for_a_passphrase(tmp_path, identities):
    key = broken(tmp_path, identities) / "tls.key"
    locked = subprocess.run(
        ["openssl", "pkey", "-aes256", "-passout", "pass:secret", "-in", key],
        capture_output=True,
        check=True,
    )
    key.write_bytes(locked.stdout)
    with pytest.raises(CertificateError):
        certificates_from(str(key.parent))


def test_a_certificate_that_nobody_accepts_says_why(tmp_path, identities):
    assert identities("old", days=-1).fault() == "certificate has expired"
    shutil.copy(identities.directory(fleet="theirs") / "ca.crt", broken(tmp_path, identities))
    assert "unable to get local issuer" in certificates_from(str(tmp_path / "broken")).fault()
