"""`waychair vocabulary`: a vocabulary from a folder of pictures, and one sentence per error."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from waychair.cli.main import app
from waychair.errors import ConfigError, OutputError, RecordingError, VocabularyError
from waychair.slam.camera.features import features_of_image
from waychair.slam.words.vocabulary_training import load


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """Return a folder with three pictures of blocks, a blank one, and a file that is no picture."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for name in ("2", "10", "9"):
        image = np.kron(rng.integers(0, 256, (24, 32)), np.ones((10, 10))).astype(np.uint8)
        cv2.imwrite(str(folder / f"{name}.png"), image)
    cv2.imwrite(str(folder / "blank.png"), np.zeros((240, 320), np.uint8))
    (folder / "broken.jpg").write_bytes(b"not a picture")
    return folder


@pytest.mark.parametrize("detector", ["orb", "sift"])
@pytest.mark.nightly
def test_a_folder_of_pictures_becomes_a_usable_vocabulary(
    pictures: Path, tmp_path: Path, detector: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "words.npz"
    app(["vocabulary", str(pictures), "-o", str(out), "--words", "50", "--detector", detector])
    told = capsys.readouterr()
    assert "50 words of " in told.out
    assert "in 4 pictures" in told.out
    assert "1 pictures of" in told.err
    assert "could not be read" in told.err
    assert "1 of 4 pictures show nothing" in told.err
    vocabulary, settings = load(out)
    assert len(vocabulary) == 50
    assert settings.detector == detector
    image = cv2.imread(str(pictures / "9.png"), cv2.IMREAD_GRAYSCALE)
    words = vocabulary.words_of(1, features_of_image(image, settings).descriptors)
    assert len(set(words.tolist())) > 10


def test_the_same_pictures_and_seed_give_the_same_words(pictures: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        app(["vocabulary", str(pictures), "-o", str(tmp_path / f"{name}.npz"), "--words", "20", "--quiet"])
    np.testing.assert_array_equal(load(tmp_path / "a.npz")[0].words, load(tmp_path / "b.npz")[0].words)


def test_pictures_without_features_give_no_file(tmp_path: Path) -> None:
    folder, out = tmp_path / "blank", tmp_path / "words.npz"
    folder.mkdir()
    with pytest.raises(RecordingError):
        app(["vocabulary", str(folder), "-o", str(out)])
    cv2.imwrite(str(folder / "1.png"), np.zeros((240, 320), np.uint8))
    with pytest.raises(VocabularyError, match="blank"):
        app(["vocabulary", str(folder), "-o", str(out)])
    (folder / "1.png").write_bytes(b"")
    with pytest.raises(VocabularyError, match="no picture"):
        app(["vocabulary", str(folder), "-o", str(out)])
    with pytest.raises(RecordingError):
        app(["vocabulary", str(tmp_path / "nowhere"), "-o", str(out)])
    assert not out.exists()


def test_an_impossible_size_or_place_is_refused(pictures: Path) -> None:
    with pytest.raises(ConfigError, match="words = 1"):
        app(["vocabulary", str(pictures), "-o", "words.npz", "--words", "1"])
    with pytest.raises(OutputError):
        app(["vocabulary", str(pictures), "-o", "/proc/nowhere/words.npz", "--words", "20"])
