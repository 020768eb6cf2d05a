"""The outside of a lesson for tests: no terminal, no mesh and no clock."""

from hub.teaching.interface import Answers


class FakeInterface:
    """observers: what answers, by name; an observer has `answer(request)`, `labels` and `alive`."""

    def __init__(self, observers):
        self.lines, self.seconds, self.observers = [], 0.0, observers

    def pause(self, seconds):
        self.seconds += seconds

    def now_s(self):
        return self.seconds

    def say(self, line):
        self.lines.append(line)

    def show(self, step):
        pass

    def fused_labels(self):
        """What most observers judge."""
        voices = [tuple(each.labels) for each in self.observers.values() if each.alive and each.labels]
        return max(voices, key=voices.count, default=())

    def ask(self, request, names):
        replies = {name: self.observers[name].answer(request) for name in names if self.observers[name].alive}
        answered = {name: reply for name, reply in replies.items() if reply is not None}
        return Answers(answered, tuple(name for name in names if name not in answered))
