"""The vocabulary: words created, shared, removed and restored; its search and inverted index; the fixed vocabulary."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from waychair.errors import VocabularyError
from waychair.slam.camera import hamming_index
from waychair.slam.camera.feature_settings import FeatureSettings
from waychair.slam.camera.features import Descriptors
from waychair.slam.camera.hamming_index import (
    CELL,
    FAR,
    HammingIndex,
    Int32Array,
    assign,
    hamming_table,
    majority,
    packed,
)
from waychair.slam.words.float_index import FloatIndex
from waychair.slam.words.inverted_index import InvertedIndex
from waychair.slam.words.vocabulary import NO_WORD, FixedVocabulary, IncrementalVocabulary, choose_words
from waychair.slam.words.vocabulary_training import TrainingSettings, load, save, train
from waychair.types import Bytes, Float32Array


def random_bits(rng: np.random.Generator, count: int) -> Bytes:
    return rng.integers(0, 256, (count, 32), dtype=np.uint8)


def flipped(rng: np.random.Generator, descriptors: Bytes, bits: int) -> Bytes:
    """The same with some bits of each inverted."""
    spread = np.unpackbits(descriptors, axis=1)
    for row in spread:
        row[rng.choice(256, bits, replace=False)] ^= 1
    return np.packbits(spread, axis=1)


def hamming_reference(a: Bytes, b: Bytes) -> Int32Array:
    """(N, M) by unpacking the bits."""
    bits_a, bits_b = np.unpackbits(a, axis=1).astype(np.int32), np.unpackbits(b, axis=1).astype(np.int32)
    return (bits_a[:, None, :] != bits_b[None, :, :]).sum(axis=2).astype(np.int32)


def floats(rng: np.random.Generator, count: int) -> Float32Array:
    values = rng.random((count, 128), dtype=np.float32)
    return np.asarray(512 * values / np.linalg.norm(values, axis=1, keepdims=True), np.float32)


def test_distances_and_assignment_agree_with_unpacked_bits() -> None:
    rng = np.random.default_rng(0)
    a, b = random_bits(rng, 40), random_bits(rng, 30)
    a[0], a[1] = 0, 255
    expected = hamming_reference(a, b)
    np.testing.assert_array_equal(hamming_table(packed(a), packed(b)), expected)
    nearest, distances = assign(packed(a), packed(b))
    np.testing.assert_array_equal(nearest, expected.argmin(axis=1))
    np.testing.assert_array_equal(distances, expected.min(axis=1))


@given(st.lists(st.integers(0, 255), min_size=32, max_size=32 * 9))
def test_the_majority_word_has_every_bit_of_the_majority(values: list[int]) -> None:
    words = np.array(values[: len(values) // 32 * 32], np.uint8).reshape(-1, 32)
    expected = np.packbits(2 * np.unpackbits(words, axis=1).sum(axis=0, dtype=int) > len(words))
    np.testing.assert_array_equal(majority(packed(words)).view(np.uint8), expected)


def test_the_search_is_exact_if_all_cells_are_searched() -> None:
    rng = np.random.default_rng(1)
    words = random_bits(rng, 6 * CELL)
    index = HammingIndex()
    index.insert(packed(words), np.arange(len(words), dtype=np.int32))
    assert 1 < index.cells <= hamming_index.PROBES
    queries = np.concatenate([random_bits(rng, 20), flipped(rng, words[:20], 30)])
    _, distances = index.nearest(packed(queries))
    exact = np.sort(hamming_reference(queries, words), axis=1)[:, :2]
    np.testing.assert_array_equal(distances, exact)


def test_similar_words_are_found_among_many_more_cells_than_are_searched() -> None:
    rng = np.random.default_rng(2)
    places = random_bits(rng, 600)
    words = np.concatenate([flipped(rng, places, 60) for _ in range(50)])
    index = HammingIndex()
    index.insert(packed(words), np.arange(len(words), dtype=np.int32))
    assert index.cells > 2 * hamming_index.PROBES
    asked = rng.choice(len(words), 300, replace=False)
    found, distances = index.nearest(packed(flipped(rng, words[asked], 20)))
    assert (found[:, 0] == asked).mean() > 0.9
    assert (distances[found[:, 0] == asked, 0] == 20).all()


def test_a_small_vocabulary_reports_missing_neighbours() -> None:
    index = HammingIndex()
    found, distances = index.nearest(packed(np.zeros((1, 32), np.uint8)))
    assert found.tolist() == [[-1, -1]]
    assert distances.tolist() == [[FAR, FAR]]
    index.insert(packed(np.zeros((1, 32), np.uint8)), np.array([7], np.int32))
    found, distances = index.nearest(packed(np.full((1, 32), 255, np.uint8)))
    assert found.tolist() == [[7, -1]]
    assert distances.tolist() == [[256, FAR]]


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_added_and_removed_words_leave_an_index_like_a_new_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    index, held = HammingIndex(), {}
    for _ in range(6):
        free = np.array([slot for slot in range(4000) if slot not in held][: rng.integers(1, 900)], np.int32)
        words = random_bits(rng, len(free))
        index.insert(packed(words), free)
        held |= dict(zip(free.tolist(), words, strict=True))
        gone = rng.choice(list(held), min(len(held) - 1, rng.integers(1, 900)), replace=False).astype(np.int32)
        index.remove(gone)
        for slot in gone.tolist():
            del held[slot]
    slots = np.array(list(held), np.int32)
    assert len(index) == len(held)
    np.testing.assert_array_equal(index.words(slots), packed(np.array(list(held.values()))))
    queries = random_bits(rng, 5)
    exact = np.sort(hamming_reference(queries, np.array(list(held.values()))), axis=1)[:, :2]
    np.testing.assert_array_equal(index.nearest(packed(queries))[1][:, : exact.shape[1]], exact)


def test_the_float_search_agrees_with_all_distances_before_and_after_a_removal() -> None:
    rng = np.random.default_rng(3)
    words, queries = floats(rng, 700), floats(rng, 10)
    index = FloatIndex()
    index.insert(words, np.arange(700, dtype=np.int32))
    index.remove(np.arange(0, 700, 2, dtype=np.int32))
    found, distances = index.nearest(queries)
    exact = ((queries[:, None] - words[None, 1::2]) ** 2).sum(axis=2)
    np.testing.assert_array_equal(found, 2 * np.argsort(exact, axis=1)[:, :2] + 1)
    np.testing.assert_allclose(distances, np.sort(exact, axis=1)[:, :2], rtol=1e-3)
    assert FloatIndex().nearest(queries)[0].max() == -1


def chosen_reference(found: Int32Array, distances: Float32Array, within: Float32Array, ratio: float) -> list[int]:
    """Candidates of the index and of this image's new words, sorted; the nearest if it is clear."""
    chosen: list[int] = []
    for i in range(len(found)):
        candidates = [(float(d), int(f)) for d, f in zip(distances[i], found[i], strict=True) if f >= 0]
        candidates += [(float(within[i, k]), -1 - k) for k in range(i) if chosen[k] == -1 - k]
        candidates.sort(key=lambda pair: pair[0])
        clear = len(candidates) >= 2 and candidates[0][0] <= ratio * candidates[1][0]
        chosen.append(candidates[0][1] if clear else -1 - i)
    return chosen


@given(st.integers(0, 2**32 - 1), st.sampled_from([0, 1, 2, 5]))
def test_words_are_assigned_by_the_ratio_of_the_nearest_two(seed: int, known: int) -> None:
    rng = np.random.default_rng(seed)
    count = 12
    within = rng.permutation(1000)[: count * count].reshape(count, count).astype(np.float32) + 1
    found = np.full((count, 2), -1, np.int32)
    distances = np.full((count, 2), FAR, np.float32)
    for i in range(count):
        here = min(known, 2)
        found[i, :here] = rng.choice(max(known, 1), here, replace=False)
        distances[i, :here] = np.sort(rng.uniform(1, 1000, here))
    chosen = choose_words(found, distances, within, 0.8)
    assert chosen.tolist() == chosen_reference(found, distances, within, 0.8)


@pytest.mark.parametrize("binary", [True, False])
def test_a_view_seen_again_has_its_old_words_and_a_new_one_has_new_words(binary: bool) -> None:
    rng = np.random.default_rng(4)
    first: Descriptors = random_bits(rng, 200) if binary else floats(rng, 200)
    other: Descriptors = random_bits(rng, 200) if binary else floats(rng, 200)
    again = flipped(rng, first, 8) if binary else first + np.float32(0.5)
    vocabulary = IncrementalVocabulary(binary=binary)
    words = vocabulary.words_of(1, first)
    assert sorted(words.tolist()) == list(range(1, 201))
    np.testing.assert_array_equal(vocabulary.words_of(2, again), words)
    assert len(vocabulary) == 200
    assert set(vocabulary.words_of(3, other).tolist()).isdisjoint(words.tolist())
    assert len(vocabulary) == 400


def test_words_are_shared_within_one_image_and_never_averaged() -> None:
    rng = np.random.default_rng(5)
    basis = random_bits(rng, 20)
    twice = np.concatenate([basis, flipped(rng, basis, 5)])
    vocabulary = IncrementalVocabulary()
    words = vocabulary.words_of(1, twice)
    np.testing.assert_array_equal(words[:20], words[20:])
    np.testing.assert_array_equal(vocabulary.descriptors_of(words[20:]), basis)


def test_descriptors_of_another_type_are_refused() -> None:
    with pytest.raises(VocabularyError, match="detector"):
        IncrementalVocabulary(binary=True).words_of(1, floats(np.random.default_rng(0), 3))
    with pytest.raises(VocabularyError, match="detector"):
        FixedVocabulary(random_bits(np.random.default_rng(0), 9)).words_of(1, floats(np.random.default_rng(0), 3))


def test_a_word_replaced_during_the_sleep_of_its_node_becomes_the_newer_word() -> None:
    rng = np.random.default_rng(6)
    place = random_bits(rng, 60)
    vocabulary = IncrementalVocabulary()
    before = vocabulary.words_of(1, place)
    vocabulary.forget(1)
    asleep = vocabulary.drop_unused()
    assert len(vocabulary) == 0
    np.testing.assert_array_equal(vocabulary.missing(before), np.sort(before))
    meanwhile = vocabulary.words_of(2, flipped(rng, place, 4))
    assert set(meanwhile.tolist()).isdisjoint(before.tolist())
    np.testing.assert_array_equal(vocabulary.recall(1, before, asleep), meanwhile)


def test_two_words_awake_together_are_never_merged() -> None:
    """Word b is new since a and c are about as near to it; seen from a, which sleeps, b alone is near."""
    bits = np.zeros((3, 256), np.uint8)
    bits[1, :12] = 1  # b differs from c in 12 bits
    bits[2, :22] = 1  # and a from b in 10
    c, b, a = np.packbits(bits, axis=1)[:, None]
    vocabulary = IncrementalVocabulary()
    words = vocabulary.words_of(1, a)
    vocabulary.words_of(2, c)
    assert vocabulary.words_of(3, b).tolist() == [3]
    vocabulary.forget(1)
    asleep = vocabulary.drop_unused()
    np.testing.assert_array_equal(vocabulary.recall(1, words, asleep), words)


def test_a_word_with_a_lost_record_is_left_out() -> None:
    rng = np.random.default_rng(7)
    vocabulary = IncrementalVocabulary()
    words = vocabulary.words_of(1, random_bits(rng, 10))
    vocabulary.forget(1)
    asleep = vocabulary.drop_unused()
    recalled = vocabulary.recall(1, words, asleep.take(words[:4]))
    np.testing.assert_array_equal(recalled[:4], words[:4])
    assert (recalled[4:] == NO_WORD).all()
    assert len(vocabulary.index.slots_of(1)) == 4


class Sleepers(RuleBasedStateMachine):
    """Nodes of a few look-alike places are seen, fall asleep and wake, in any order."""

    def __init__(self) -> None:
        super().__init__()
        self.rng = np.random.default_rng(0)
        self.places = [random_bits(self.rng, 30) for _ in range(3)]
        self.vocabulary = IncrementalVocabulary()
        self.awake: dict[int, Int32Array] = {}
        self.asleep: dict[int, Int32Array] = {}
        self.kept: dict[int, tuple[Bytes, int]] = {}
        self.node = 0

    @rule(place=st.integers(0, 2), bits=st.integers(0, 40))
    def see(self, place: int, bits: int) -> None:
        self.node += 1
        self.awake[self.node] = self.vocabulary.words_of(self.node, flipped(self.rng, self.places[place], bits))

    def put_to_sleep(self, node: int) -> None:
        self.vocabulary.forget(node)
        dropped = self.vocabulary.drop_unused()
        for word, descriptor, since in zip(dropped.ids.tolist(), dropped.descriptors, dropped.since, strict=True):
            self.kept[word] = (descriptor, int(since))
        self.asleep[node] = self.awake.pop(node)

    def call_back(self, node: int) -> Int32Array:
        words = self.asleep.pop(node)
        missing = self.vocabulary.missing(words)
        asleep = self.vocabulary.no_words()
        if len(missing):
            kept = [self.kept[word] for word in missing.tolist()]
            since = np.array([moment for _, moment in kept], np.int32)
            asleep = type(asleep)(missing, np.array([descriptor for descriptor, _ in kept]), since)
        self.awake[node] = self.vocabulary.recall(node, words, asleep)
        return self.awake[node]

    @precondition(lambda self: self.awake)
    @rule(data=st.data())
    def sleep(self, data: st.DataObject) -> None:
        self.put_to_sleep(data.draw(st.sampled_from(sorted(self.awake))))

    @precondition(lambda self: self.asleep)
    @rule(data=st.data())
    def wake(self, data: st.DataObject) -> None:
        self.call_back(data.draw(st.sampled_from(sorted(self.asleep))))

    @precondition(lambda self: self.awake)
    @rule(data=st.data())
    def nod_off(self, data: st.DataObject) -> None:
        """Removed and restored with no change between: the same ids."""
        node = data.draw(st.sampled_from(sorted(self.awake)))
        before, known = self.awake[node], len(self.vocabulary)
        self.put_to_sleep(node)
        np.testing.assert_array_equal(self.call_back(node), before)
        assert len(self.vocabulary) == known

    @invariant()
    def every_word_awake_is_referred_to_and_every_reference_is_awake(self) -> None:
        words = {int(word) for words in self.awake.values() for word in words}
        assert len(self.vocabulary.missing(np.array(sorted(words), np.int32))) == 0
        assert len(self.vocabulary) == len(words)

    @invariant()
    def the_inverted_index_equals_one_made_anew(self) -> None:
        anew = InvertedIndex()
        slots = {node: self.vocabulary.index.slots_of(node) for node in self.awake}
        for node, own in slots.items():
            anew.add(node, own)
        assert len(self.vocabulary.index) == len(anew)
        for slot in {int(slot) for own in slots.values() for slot in own}:
            assert self.vocabulary.index.postings(slot) == anew.postings(slot)


TestSleepers = Sleepers.TestCase
TestSleepers.settings = settings(max_examples=25, stateful_step_count=20)


def test_k_majority_finds_the_centres_of_well_separated_clusters() -> None:
    rng = np.random.default_rng(8)
    middles = random_bits(rng, 12)
    descriptors = np.concatenate([flipped(rng, middles, 12) for _ in range(31)])
    words = train(descriptors, TrainingSettings(words=12), rounds=30)
    # From random starts two clusters may end in one, and one in two.
    assert (hamming_reference(words, middles).min(axis=0) <= 5).sum() >= 10
    expected = hamming_reference(descriptors, words).argmin(axis=1) + 1
    np.testing.assert_array_equal(FixedVocabulary(words).words_of(1, descriptors), expected)
    np.testing.assert_array_equal(words, train(descriptors, TrainingSettings(words=12), rounds=30))


def test_k_means_lowers_the_error_and_a_fixed_vocabulary_gives_the_nearest_word() -> None:
    rng = np.random.default_rng(9)
    middles = floats(rng, 10)
    descriptors = np.concatenate([middles + rng.normal(0, 2, middles.shape).astype(np.float32) for _ in range(30)])
    one = train(descriptors, TrainingSettings(words=10), rounds=1)
    many = train(descriptors, TrainingSettings(words=10), rounds=30)

    def error(words: Float32Array) -> float:
        return float(((descriptors[:, None] - words[None]) ** 2).sum(axis=2).min(axis=1).mean())

    assert error(many) <= error(one)
    expected = ((descriptors[:, None] - many[None]) ** 2).sum(axis=2).argmin(axis=1) + 1
    np.testing.assert_array_equal(FixedVocabulary(many).words_of(1, descriptors), expected)


def test_a_fixed_vocabulary_removes_and_restores_nodes_but_keeps_its_words() -> None:
    rng = np.random.default_rng(10)
    vocabulary = FixedVocabulary(random_bits(rng, 50))
    words = vocabulary.words_of(1, random_bits(rng, 80))
    vocabulary.forget(1)
    assert 1 not in vocabulary.index
    assert len(vocabulary.drop_unused()) == len(vocabulary.missing(words)) == 0
    np.testing.assert_array_equal(vocabulary.recall(1, words, vocabulary.no_words()), words)
    np.testing.assert_array_equal(vocabulary.index.slots_of(1) + 1, words)


def test_a_vocabulary_on_disk_equals_the_saved_one(tmp_path: Path) -> None:
    words = random_bits(np.random.default_rng(11), 40)
    features = FeatureSettings(detector="orb", max_features=321)
    save(tmp_path / "words.npz", words, features)
    vocabulary, read = load(tmp_path / "words.npz")
    np.testing.assert_array_equal(vocabulary.words, words)
    assert read == features


def test_an_earlier_vocabulary_is_read_if_its_settings_equal_the_present_constants(tmp_path: Path) -> None:
    words = random_bits(np.random.default_rng(11), 40)
    for threshold, known in ((10, True), (20, False)):
        text = f"{{detector: orb, max_features: 321, fast_threshold: {threshold}, levels: 8}}"
        np.savez_compressed(tmp_path / "words.npz", format=np.int64(1), words=words, features=np.array(text))
        if known:
            assert load(tmp_path / "words.npz")[1] == FeatureSettings(detector="orb", max_features=321)
        else:
            with pytest.raises(VocabularyError, match="fast_threshold is fixed at 10"):
                load(tmp_path / "words.npz")


@pytest.mark.parametrize("damage", ["missing", "empty", "cut", "text"])
def test_a_damaged_vocabulary_is_refused_in_one_sentence(tmp_path: Path, damage: str) -> None:
    path = tmp_path / "words.npz"
    save(path, random_bits(np.random.default_rng(12), 40), FeatureSettings())
    data = path.read_bytes()
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes({"empty": b"", "cut": data[: len(data) // 2], "text": b"no dictionary"}[damage])
    with pytest.raises(VocabularyError, match="make"):
        load(path)


def test_too_few_descriptors_give_no_vocabulary() -> None:
    with pytest.raises(VocabularyError, match="more features"):
        train(np.zeros((50, 32), np.uint8))
