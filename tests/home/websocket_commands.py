"""Commands to Home Assistant's websocket, as its pages send them; run by the Python that has Home Assistant. Arguments:
URL and token. Standard input: a JSON list of commands; standard output: the list of their results."""

import asyncio
import json
import sys

import aiohttp


async def send(url, token, commands):
    async with aiohttp.ClientSession() as session, session.ws_connect(url) as socket:
        await socket.receive_json()
        await socket.send_json({"type": "auth", "access_token": token})
        assert (await socket.receive_json())["type"] == "auth_ok"
        results = []
        for number, command in enumerate(commands, 1):
            await socket.send_json({"id": number, **command})
            results.append(await socket.receive_json())
        return results


print(json.dumps(asyncio.run(send(sys.argv[1], sys.argv[2], json.load(sys.stdin)))))
