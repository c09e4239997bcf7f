"""A user's shell on a computer: typed input, displayed output, and Ctrl-C."""

import os
import pty
import re
import subprocess
import threading

from tested_fleet import PATIENCE

PROMPT = re.compile(r"<shell (\d+)>\$ ")
"""The prompt, with the status of the previous command; nothing else prints this."""
REPEAT = 1.0 / 30.0
"""Repeat interval of a held key [s]."""


class Shell:
    """An interactive bash in its own terminal on one computer, through ``docker exec -it``."""

    def __init__(self, container: str) -> None:
        master, slave = pty.openpty()
        command = [
            "docker",
            "exec",
            "-it",
            container,
            "env",
            "PS1=<shell $?>$ ",
            "bash",
            "--norc",
            "--noediting",
            "-i",
        ]
        self._process = subprocess.Popen(
            command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True
        )
        os.close(slave)
        self._master, self._changed = master, threading.Condition()
        #: text: everything that the terminal has shown
        self.text, self._ended, self._typed = "", False, 0
        self._thread = threading.Thread(target=self._read)
        self._thread.start()
        self._prompt(PATIENCE)

    def _read(self) -> None:
        ended = False
        while not ended:
            try:
                data = os.read(self._master, 65536)
            except OSError:  # on Linux, this means that the other end of the terminal is closed
                data = b""
            ended = not data
            with self._changed:
                self.text += data.decode(errors="replace")
                self._ended = ended
                self._changed.notify_all()

    def _is_idle(self) -> bool:
        return self._ended or PROMPT.search(self.text, self._typed) is not None

    def _prompt(self, timeout: float) -> bool:
        """Waits for the prompt after the last typed command; returns whether it came."""
        with self._changed:
            return self._changed.wait_for(self._is_idle, timeout)

    def type(self, line: str) -> None:
        """Types a command and Enter."""
        with self._changed:
            self._typed = len(self.text)
        os.write(self._master, f"{line}\n".encode())

    def run(self, line: str) -> str:
        """Types a command, waits until it ends and returns its output."""
        self.type(line)
        assert self._prompt(PATIENCE), f"it does not end:\n{self.text[-3000:]}"
        return self.text[self._typed :]

    def shows(self, words: str, timeout: float = PATIENCE) -> None:
        """Waits until the last command has shown ``words``; fails if the command ends or the time is up before."""
        with self._changed:
            self._changed.wait_for(
                lambda: words in self.text[self._typed :] or self._is_idle(), timeout
            )
            shown = self.text[self._typed :]
            assert words in shown, f"no {words!r} in:\n{shown[-3000:]}"

    def interrupt(self, held: bool = False, timeout: float = 60.0) -> int:
        """Presses or holds Ctrl-C until the command has ended; returns the command's status."""
        with self._changed:
            if not self._is_idle():
                os.write(self._master, b"\x03")
        while not self._prompt(REPEAT if held else timeout):
            timeout -= REPEAT if held else timeout
            assert timeout > 0.0, f"it does not end:\n{self.text[-3000:]}"
            os.write(self._master, b"\x03")
        prompt = PROMPT.search(self.text, self._typed)
        assert prompt is not None, f"the shell has ended:\n{self.text[-3000:]}"
        return int(prompt[1])

    def close(self) -> None:
        """Exits the shell, after Ctrl-C for a command that is still running."""
        if not self._ended:
            os.write(self._master, b"\x03\nexit\n")
        self._process.wait(60.0)
        self._thread.join(60.0)
        os.close(self._master)
