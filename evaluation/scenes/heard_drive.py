"""One guided drive listened to: its sound track as a file, and by measurement one voice, its level, and silence after warnings."""

from __future__ import annotations

from pathlib import Path

from waychair.calibration.chair_body import CHAIR_A
from waychair.simulation.plan.world import load_world
from waychair.trials.guiding.guided import GuidedSetup, guided_trial
from waychair.trials.guiding.sound_track import SoundTrack, heard_figures
from waychair.trials.navigate import world_with_people
from waychair.types import Json

START, GOAL, PEOPLE, LIMIT_S = "ward", "bath", 2, 240.0


def heard_drive(path: Path) -> Json:
    """Drive once, write the track to a WAV file, and return its figures.

    Raises:
        ConfigError: there is no speech program.
        OutputError: the file cannot be written.
    """
    plan, track = load_world("small_clinic"), SoundTrack()
    places = {place.name: place for place in plan.places}
    world = world_with_people(plan, places[START].pose, PEOPLE, seed=0)
    setup = GuidedSetup(world, plan.grid, CHAIR_A, track=track)
    with guided_trial(setup) as trial:
        record = trial.drive_to(places[GOAL], LIMIT_S)
    track.save(path)
    warnings = [said.stamp_ns for said in record.told if said.symbol == "warning"]
    heard = heard_figures(track, warnings)
    return {
        "track": path.name,
        "reached": record.reached,
        "seconds": round(record.seconds, 1),
        "spoken": sum(bool(sound.words) for sound in track.sounds),
        "overlaps": heard.overlaps,
        "speech_dbfs": round(heard.speech_dbfs, 1),
        "peak_dbfs": round(heard.peak_dbfs, 1),
        "warnings": heard.warnings,
        "passed": record.reached and heard.is_fit,
    }
