from __future__ import annotations

import threading

from humanoid_sim.messages import Intent
from humanoid_sim.session.sources import IntentQueue


def test_an_intent_queue_gives_everything_once_and_in_order() -> None:
    queue = IntentQueue()
    assert list(queue.poll(0.0, None)) == []
    for intent in (Intent.LOAD_A, Intent.DAMP, Intent.DAMP):
        queue.put(intent)
    assert list(queue.poll(0.0, None)) == [Intent.LOAD_A, Intent.DAMP, Intent.DAMP]
    assert list(queue.poll(0.0, None)) == []
    assert not queue.finished


def test_an_intent_queue_loses_nothing_between_threads() -> None:
    queue = IntentQueue()
    count, kinds = 5000, list(Intent)[:4]
    got: list[Intent] = []

    def send(intent: Intent) -> None:
        for _ in range(count):
            queue.put(intent)

    threads = [threading.Thread(target=send, args=(intent,)) for intent in kinds]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        got += queue.poll(0.0, None)
    got += queue.poll(0.0, None)
    for thread in threads:
        thread.join()
    assert {intent: got.count(intent) for intent in kinds} == dict.fromkeys(kinds, count)
