"""Clients that post one plan request over and over: as many at a time, or as many a second."""

from __future__ import annotations

import asyncio
import json
import time
from dataclasses import dataclass

__all__ = ["Sample", "Target"]


Connection = tuple[asyncio.StreamReader, asyncio.StreamWriter]


@dataclass(frozen=True, slots=True)
class Sample:
    """One request: its status (0: no answer came), how long (s) it took, and the body of its answer."""

    status: int
    seconds: float
    body: bytes


class Target:
    """POST /v1/plans of a service on this machine, over connections that are kept open."""

    def __init__(self, port: int, body: bytes) -> None:
        head = "POST /v1/plans HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
        self._port = port
        self._request = head.encode() + b"Content-Length: %d\r\n\r\n%b" % (len(body), body)
        self._idle: list[Connection] = []

    async def closed(self, clients: int, seconds: float) -> list[Sample]:
        """Each client sends its next request when the last has been answered, or when it may try again."""
        end = time.perf_counter() + seconds

        async def client() -> list[Sample]:
            samples = []
            while time.perf_counter() < end:
                samples.append(sample := await self.ask())
                if sample.status == 429:
                    await asyncio.sleep(json.loads(sample.body)["retry_after"])
            return samples

        return [
            sample
            for theirs in await asyncio.gather(*(client() for _ in range(clients)))
            for sample in theirs
        ]

    async def paced(self, rate: float, seconds: float) -> list[Sample]:
        """A request every 1/rate s, however many are unanswered."""
        begin, asked = time.perf_counter(), []
        for i in range(round(rate * seconds)):
            await asyncio.sleep(begin + i / rate - time.perf_counter())
            asked.append(asyncio.create_task(self.ask()))
        return list(await asyncio.gather(*asked))

    async def ask(self) -> Sample:
        """One request."""
        began = time.perf_counter()
        try:
            status, body = await self._exchange(await self._connection())
        except (OSError, EOFError):
            status, body = 0, b""
        return Sample(status, time.perf_counter() - began, body)

    async def _connection(self) -> Connection:
        while self._idle:
            reader, writer = self._idle.pop()
            if not reader.at_eof():  # the service closes what has been idle for long
                return reader, writer
            writer.close()
        return await asyncio.open_connection("127.0.0.1", self._port, limit=1 << 20)

    async def _exchange(self, connection: Connection) -> tuple[int, bytes]:
        reader, writer = connection
        writer.write(self._request)
        head = (await reader.readuntil(b"\r\n\r\n")).lower()
        body = await reader.readexactly(int(head.partition(b"content-length: ")[2].split(b"\r\n")[0]))
        if b"connection: close" in head:
            writer.close()
        else:
            self._idle.append((reader, writer))
        return int(head.split(maxsplit=2)[1]), body
