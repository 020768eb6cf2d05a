"""Bare Zenoh sessions beside a scene: an attacker, which follows no rule of labanmesh, and a witness."""

import time
from collections import defaultdict
from itertools import pairwise

import zenoh
from attack_peers import opened

from common import SECOND_NS
from common.messages import JudgementMessage, VerdictMessage
from common.wire import BadMessage, decode

FORGED_NS = 600 * SECOND_NS
"""A message whose time is so far from now was forged, or is a replay."""


class Attacker:
    """A bare Zenoh session: puts, queries, queryables and tokens under any key."""

    def __init__(self, endpoint, history, mode="peer"):
        self.session, self._history, self._declared = opened(endpoint, mode), history, []

    def put(self, key, payload, **how):
        """One message; how: as `zenoh.Session.put`, a congestion control for example."""
        self._history.note("put", key=key, bytes=len(payload), head=bytes(payload[:24]).hex())
        self.session.put(key, payload, **how)

    def ask(self, selector, payload=None, timeout_s=0.5):
        """All answers to a query, key and bytes."""
        self._history.note("query", selector=selector, payload=payload)
        replies = self.session.get(selector, payload=payload, timeout=timeout_s, target=zenoh.QueryTarget.ALL)
        return [(str(reply.ok.key_expr), reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]

    def answer(self, key, respond):
        """Answer queries for `key` with the payloads that `respond()` returns."""

        def reply(query):
            with query:
                for payload in respond():
                    query.reply(key, payload)

        self._history.note("queryable", key=key)
        self._declared.append(self.session.declare_queryable(key, reply, complete=True))

    def token(self, key):
        """A liveliness token, until the attacker leaves."""
        self._history.note("token", key=key)
        self._declared.append(self.session.liveliness().declare_token(key))

    def close(self):
        self.session.close()


class Witness:
    """What was published on judgement and verdict of every scene: (arrived_ns, message), and what nobody can read."""

    def __init__(self, attacker):
        self.judgements, self.verdicts = defaultdict(list), defaultdict(list)
        self.unreadable, self.largest = [], 0
        kinds = {"judgement": (JudgementMessage, self.judgements), "verdict": (VerdictMessage, self.verdicts)}

        def note(sample):
            _, scene, kind = str(sample.key_expr).split("/")
            payload, now_ns = sample.payload.to_bytes(), time.time_ns()
            message_type, taken = kinds[kind]
            try:
                message = decode(message_type, payload)
            except BadMessage as error:
                self.unreadable.append((str(sample.key_expr), error))
                return
            self.largest = max(self.largest, len(payload))
            # What an attacker forges is not what a service has said.
            if abs(message.at_ns - now_ns) < FORGED_NS:
                taken[scene].append((now_ns, message))

        for kind in kinds:
            attacker.session.declare_subscriber(f"laban/*/{kind}", note)

    def last(self, scene):
        """The newest judgement of a scene; None before the first."""
        return self.judgements[scene][-1][1] if self.judgements[scene] else None

    def states(self, scene):
        """By observer the state of its vote now."""
        last = self.last(scene)
        return {} if last is None else {name: vote.state for name, vote in last.votes.items()}

    def longest_gap_s(self, scene, since_ns):
        """The longest time between two judgements that arrived, by the time at which they were made."""
        made_ns = (message.at_ns for _, message in self.judgements[scene])
        times = sorted([since_ns, *(at_ns for at_ns in made_ns if at_ns > since_ns)])
        return max(b - a for a, b in pairwise(times)) / SECOND_NS

    def leaders(self, scene, since_ns):
        """The fusion services that published since then."""
        return {message.fusion for at, message in self.judgements[scene] if at > since_ns}
