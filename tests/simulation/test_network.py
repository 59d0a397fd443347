"""The seeded network: the same calls meet the same faults, and each fault is as large as told."""

from __future__ import annotations

from waychair.simulation.network import NetworkFaults, SeededNetwork


def _arrivals(network: SeededNetwork, messages: int, every_ns: int = 10**6) -> list[tuple[int, bytes]]:
    found = []
    for k in range(messages):
        network.send(k * every_ns, 1, (2,), k.to_bytes(4, "big"))
        found += network.received(k * every_ns, 2)
    return found + network.received(10**18, 2)


def test_a_sound_network_brings_everything_once_in_order() -> None:
    found = _arrivals(SeededNetwork(1, NetworkFaults(delay_ms=0.0)), 100)
    assert found == [(1, k.to_bytes(4, "big")) for k in range(100)]


def test_loss_doubling_and_reordering_are_as_told_and_repeat() -> None:
    faults = NetworkFaults(loss=0.2, doubled=0.1, delay_ms=20.0, late=0.05)
    first, again, other = (_arrivals(SeededNetwork(seed, faults), 5000) for seed in (7, 7, 8))
    assert first == again != other
    numbers = [int.from_bytes(data, "big") for _, data in first]
    assert abs(len(set(numbers)) / 5000 - 0.8) < 0.02
    assert abs(len(numbers) / len(set(numbers)) - 1.1) < 0.02
    assert numbers != sorted(numbers)


def test_parts_and_deaf_links_carry_nothing_until_they_are_healed() -> None:
    network = SeededNetwork(1, NetworkFaults(delay_ms=0.0))

    def hears(source: int, other: int) -> bool:
        network.send(0, source, (other,), b"x")
        return bool(network.received(10**9, other))

    network.part([(1, 2), (3,)])
    assert hears(1, 2)
    assert not hears(1, 3)
    assert not hears(4, 1)
    network.heal()
    network.deafen([(1, 2)])
    assert not hears(1, 2)
    assert hears(2, 1)
    network.heal()
    assert hears(1, 2)


def test_clocks_drift_no_more_than_told_and_never_run_backwards() -> None:
    network = SeededNetwork(3, NetworkFaults(drift_ppm=200.0))
    for own in range(5):
        ran = network.clock_ns(10**12, own) - network.clock_ns(0, own)
        assert 0 < abs(ran - 10**12) <= 200_000_000


def test_a_computer_that_crashed_has_lost_its_mail() -> None:
    network = SeededNetwork(1, NetworkFaults(delay_ms=0.0))
    network.send(0, 1, (2,), b"x")
    assert network.received(10**9, 3) == []
    network.forget(2)
    assert network.received(10**9, 2) == []
