"""`waychair vocabulary`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from waychair.cli.options.arguments import NonNegativeInt
from waychair.cli.options.recording_options import RecordingOptions, stages

AS_RECORDED = RecordingOptions()


def vocabulary_command(
    source: Path,
    /,
    *,
    out: Annotated[Path, Parameter(name=["--out", "-o", "--output"])],
    words: NonNegativeInt = 16_000,
    detector: Literal["orb", "gftt_orb", "sift"] = "orb",
    seed: NonNegativeInt = 1,
    reading: RecordingOptions = AS_RECORDED,
    config: Path | None = None,
    quiet: bool = False,
) -> None:
    """Make a fixed vocabulary of visual words by clustering: k-majority of binary features, k-means of float ones.

    Mapping does not need it, as it builds its vocabulary incrementally. A fixed one serves for comparison.

    Parameters
    ----------
    source
        A folder of pictures, or a recording with pictures.
    out
        The file to write, such as building.npz.
    words
        Size of the vocabulary; a small one distinguishes places badly.
    detector
        Kind of features; SURF is not in OpenCV 5, sift is the most similar.
    seed
        Seed of the clustering: the same pictures and seed give the same words.
    config
        YAML file with settings that differ from the defaults (see `waychair config map`): its input applies.
    quiet
        Print nothing but errors.
    """
    from waychair.cli.options.configuration import load_recording_settings
    from waychair.offline.mapping import MappingSettings
    from waychair.offline.vocabulary_making import VocabularyMakingSettings, make_vocabulary

    settings = VocabularyMakingSettings()
    settings = replace(
        settings,
        input=reading.over(load_recording_settings(config, MappingSettings).input),
        features=replace(settings.features, detector=detector),
        training=replace(settings.training, words=words, seed=seed),
    )
    with stages(quiet) as bar:
        made = make_vocabulary(source, out, settings, bar.stage)
        bar.warn(made.warnings)
        if made.unreadable:
            bar.warn([f"{made.unreadable} pictures of {source} could not be read"])
        if made.blank:
            bar.warn([f"{made.blank} of {made.pictures} pictures show nothing"])
        if made.words < words:
            bar.warn([f"only {made.words} words, as there are no more distinct features"])
    if not quiet:
        print(f"{out}: {made.words} words of {made.descriptors} features in {made.pictures} pictures")
