"""The answers of the page's web application, without a server."""

import asyncio

import httpx


def answers_of(app, *requests, host="127.0.0.1", client="127.0.0.1"):
    """Those to (method, path, more), one after the other."""

    async def main():
        transport = httpx.ASGITransport(app, client=(client, 1234))
        async with httpx.AsyncClient(transport=transport, base_url=f"http://{host}") as browser:
            return [await browser.request(method, path, **more) for method, path, more in requests]

    return asyncio.run(main())
