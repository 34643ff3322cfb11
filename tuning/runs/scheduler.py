"""A Dask scheduler that runs already: whether an address is one, and whether it has workers."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable
from typing import Any

from tuning.files.errors import InputError, input_error

CONNECT_WITHIN = 10.0
"""Time that a scheduler has to answer [s]."""
TELL_EVERY = 10.0
"""Time after which it is said, again and again, that there are no workers [s]."""
_LOOK_EVERY = 1.0


def require_scheduler(address: str) -> None:
    """Refuse an address at which no Dask scheduler answers in time.

    What listens there may be anything: a web server waits for more, and a client of Dask for ever with it.

    Raises:
        InputError: nothing listens there, or something else than a scheduler.
    """
    from distributed.comm.addressing import get_address_host_port

    try:
        get_address_host_port(address)
    except ValueError as error:
        raise unreachable(address, f"cannot be reached ({error})") from None
    try:
        identity = asyncio.run(_identity(address))
    except TimeoutError:
        raise _no_scheduler(address, f"says nothing for {CONNECT_WITHIN:g} s") from None
    except OSError as error:
        raise unreachable(address, f"cannot be reached ({error})") from None
    except Exception as error:
        # Whatever comes of bytes that were meant for somebody else: a struct, numpy's or msgpack's own error.
        raise _no_scheduler(address, f"{type(error).__name__} in its answer") from None
    what = identity.get("type") if isinstance(identity, dict) else None
    if what is None or "Scheduler" not in str(what):
        raise _no_scheduler(address, f"it is a {what}")


async def _identity(address: str) -> Any:
    from distributed.comm.core import connect
    from distributed.core import send_recv
    from distributed.security import Security

    async def asked() -> Any:
        comm = await connect(address, CONNECT_WITHIN, **Security().get_connection_args("client"))
        try:
            return await send_recv(comm, op="identity")
        finally:
            comm.abort()

    # Dask's own limit ends once something accepts the connection.
    return await asyncio.wait_for(asked(), CONNECT_WITHIN + 1.0)


def unreachable(address: str, problem: str) -> InputError:
    """Return the error of a scheduler that is not there."""
    return input_error(f"scheduler {address}", problem, "start it and its workers; go on with --resume")


def _no_scheduler(address: str, why: str) -> InputError:
    return input_error(
        f"scheduler {address}",
        f"what listens there does not answer as a Dask scheduler does ({why})",
        "name the address that `dask scheduler` prints as 'Scheduler at'; its dashboard has another port",
    )


class Patience:
    """Looks from time to time whether a scheduler has workers, and says so while it has none.

    Args:
        address: of the scheduler.
        workers: returns how many it has; may fail with an `OSError` where that is not known.
        limit: time without any after which to give up [s]; `None`: never.
        tell: where to say it.
    """

    def __init__(
        self,
        address: str,
        workers: Callable[[], int],
        limit: float | None,
        tell: Callable[[str], None] = lambda text: print(text, file=sys.stderr, flush=True),
    ):
        self._address, self._workers, self._limit, self._tell = address, workers, limit, tell
        self._last_look = self._last_word = self._had_some = time.monotonic()

    def look(self) -> None:
        """Look, if it is time to.

        Raises:
            InputError: there were no workers for as long as the limit.
        """
        now = time.monotonic()
        if now - self._last_look < _LOOK_EVERY:
            return
        self._last_look = now
        try:
            count = self._workers()
        except OSError:
            return
        if count:
            self._last_word = self._had_some = now
            return
        waited = now - self._had_some
        if self._limit is not None and waited >= self._limit:
            raise unreachable(self._address, f"no workers within {self._limit:g} s (--wait)")
        if now - self._last_word >= TELL_EVERY:
            self._last_word = now
            start = f"dask worker {self._address} --nthreads 1"
            until = "" if self._limit is None else f", giving up after {self._limit:g} s"
            self._tell(
                f"scheduler {self._address}: no workers yet, for {waited:.0f} s{until}; start some: {start}"
            )
