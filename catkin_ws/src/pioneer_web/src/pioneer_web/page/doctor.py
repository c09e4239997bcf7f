"""Runs the gateways' doctor as a process of its own, which ends with its time-out."""

import asyncio
import json
import os
import signal
from typing import Any

LIMIT = 60.0
"""Time-out for the examination of all gateways [s]."""
_COMMAND = ("rosrun", "rocon_gateway", "doctor", "--json")


async def examine() -> list[dict[str, Any]]:
    """Returns the doctor's findings, each with ``level``, ``what`` and ``fix``; its own failure is one of them."""
    pipe, null = asyncio.subprocess.PIPE, asyncio.subprocess.DEVNULL
    try:
        process = await asyncio.create_subprocess_exec(
            *_COMMAND, stdout=pipe, stderr=null, start_new_session=True
        )
    except OSError as error:
        return _no_answer(str(error))
    try:
        text, _ = await asyncio.wait_for(process.communicate(), LIMIT)
        return list(json.loads(text)["findings"])
    except TimeoutError:
        return _no_answer(f"timed out after {LIMIT:.0f} s")
    except (ValueError, KeyError, TypeError) as error:
        return _no_answer(str(error))
    finally:
        if process.returncode is None:
            os.killpg(process.pid, signal.SIGKILL)


def _no_answer(reason: str) -> list[dict[str, Any]]:
    return [{"level": "fault", "what": f"the doctor does not answer: {reason}", "fix": ""}]
