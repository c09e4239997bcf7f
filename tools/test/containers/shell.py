"""A person's shell on a computer: what is typed into it, what it shows, and Ctrl-C."""

import os
import pty
import re
import subprocess
import threading

from containers.harness import PATIENCE

PROMPT = re.compile(r"<shell (\d+)>\$ ")
"""Nothing else prints that; with the status of the command before."""
REPEAT = 1.0 / 30.0
"""A key that is held comes again after so long [s]."""


class Shell:
    """An interactive bash in a terminal of its own on one computer, by ``docker exec -it``."""

    def __init__(self, container: str) -> None:
        master, slave = pty.openpty()
        command = ["docker", "exec", "-it", container, "env", "PS1=<shell $?>$ ", "bash", "--norc", "--noediting", "-i"]
        self._process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
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
            except OSError:  # how Linux says that the other end of a terminal is closed
                data = b""
            ended = not data
            with self._changed:
                self.text += data.decode(errors="replace")
                self._ended = ended
                self._changed.notify_all()

    def _is_idle(self) -> bool:
        return self._ended or PROMPT.search(self.text, self._typed) is not None

    def _prompt(self, timeout: float) -> bool:
        """Waits for the prompt that follows what was typed last; returns whether it came."""
        with self._changed:
            return self._changed.wait_for(self._is_idle, timeout)

    def type(self, line: str) -> None:
        """Types a command and Enter."""
        with self._changed:
            self._typed = len(self.text)
        os.write(self._master, f"{line}\n".encode())

    def run(self, line: str) -> str:
        """Types a command, waits for its end and returns what the terminal shows of it."""
        self.type(line)
        assert self._prompt(PATIENCE), f"it does not end:\n{self.text[-3000:]}"
        return self.text[self._typed :]

    def shows(self, words: str, timeout: float = PATIENCE) -> None:
        """Waits until ``words`` have been shown since the last command; fails when that ends before, or time is up."""
        with self._changed:
            self._changed.wait_for(lambda: words in self.text[self._typed :] or self._is_idle(), timeout)
            shown = self.text[self._typed :]
            assert words in shown, f"no {words!r} in:\n{shown[-3000:]}"

    def interrupt(self, held: bool = False, timeout: float = 60.0) -> int:
        """Presses Ctrl-C, or holds it, until the command has ended; returns the command's status."""
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
        """Leaves the shell, with Ctrl-C for whatever runs in it."""
        if not self._ended:
            os.write(self._master, b"\x03\nexit\n")
        self._process.wait(60.0)
        self._thread.join(60.0)
        os.close(self._master)
