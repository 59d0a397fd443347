"""`python -m evaluation [NAME ...]`: run the named figures, or all, and report whether each bar is met."""

from __future__ import annotations

import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from evaluation.figures.buildings import floor_graphs, hgraph, journeys, rooms
from evaluation.figures.chair import (
    bridge,
    calibration,
    closed_loop,
    editor,
    glove,
    guard,
    menus,
    sensor_time,
    simulation,
    start_up,
)
from evaluation.figures.driving import (
    barn,
    behaviours,
    demo,
    doorways,
    drive_time,
    dstar_lite,
    dwa,
    guidance,
    harmonic,
    hazards,
    laser_line,
    monitor,
    nights,
    real_maps,
    scenes,
    situations,
    wrong_chairs,
)
from evaluation.figures.fleet import alone, drive, gap, grids, live, narrow, network, page, scale, tables
from evaluation.figures.guiding import (
    blind_clutter,
    blind_doors,
    blind_errands,
    blind_hazards,
    blind_people,
    blind_places,
    blind_unmapped,
    skin,
)
from evaluation.figures.mapping import (
    appearance,
    camera_fit,
    carried,
    cases,
    corruptions,
    depth_grid,
    floors,
    kidnap,
    lifelong,
    live_grid,
    logs,
    map_all,
    mapping,
    memory,
    odometry,
    rgbd,
    submap_signatures,
)
from evaluation.figures.pose_graphs import posegraphs, spatial_posegraphs
from waychair.files import write_json
from waychair.types import Json


def _with_ros(module: str, name: str) -> Callable[[Path], Json]:
    """Return a figure of a module that needs ROS; the module is imported when the figure runs."""

    def figure(out: Path) -> Json:
        found: Json = getattr(import_module(f"evaluation.figures.{module}"), name)(out)
        return found

    return figure


FIGURES: dict[str, Callable[[Path], Json]] = {
    "intel": logs.intel,
    "fr079": logs.fr079,
    "sena": logs.sena,
    "coreslam": logs.coreslam,
    "sim_mapping": mapping.sim_mapping,
    "growth": mapping.growth,
    "growth_large": mapping.growth_large,
    "live_grid": live_grid.live_grid,
    "carried": carried.carried,
    "false_tears": carried.false_tears,
    "submap_signatures": submap_signatures.submap_signatures,
    "corruptions": corruptions.corruptions,
    "cases": cases.cases,
    "map_all": map_all.map_all,
    "rooms": rooms.rooms,
    "floor_graphs": floor_graphs.floor_graphs,
    "kidnap": kidnap.fr079,
    "kidnap_simulated": kidnap.simulated,
    "posegraphs": posegraphs.posegraphs,
    "false_loops": posegraphs.false_loops,
    "spatial_posegraphs": spatial_posegraphs.spatial_posegraphs,
    "places": appearance.places,
    "words_speed": appearance.words_speed,
    "tum_rpy": rgbd.tum_rpy,
    "tsdf_sample": rgbd.tsdf_sample,
    "camera_fit": camera_fit.camera_fit,
    "bounded": memory.bounded,
    "killed": memory.killed,
    "lifelong": lifelong.lifelong,
    "depth_grid": depth_grid.limits,
    "edges_mapped": depth_grid.edges_mapped,
    "floors": floors.floors,
    "alias": floors.alias,
    "demo": demo.run,
    "nights": nights.nights,
    "movingai": dstar_lite.movingai,
    "closures": dstar_lite.closures,
    "replan": dstar_lite.replan,
    "first_plan": dstar_lite.first_plan,
    "near_field": dstar_lite.near_field,
    "hgraph": hgraph.hgraph,
    "barn": barn.barn,
    "barn_fast": barn.barn_fast,
    "barn_chair": barn.barn_chair,
    "fan": dwa.fan,
    "control_step": dwa.step,
    "u_trap": dwa.u_trap,
    "doorways_real": doorways.doorways_real,
    "doorways_sim": doorways.doorways_sim,
    "doorways_photos": doorways.doorways_photos,
    "doors": scenes.doors,
    "door_drives": scenes.door_drives,
    "corner": scenes.corner,
    "drive_time": drive_time.drive_time,
    "dead_end": scenes.dead_end,
    "parked": scenes.parked,
    "situations": situations.situations,
    "guidance": guidance.guidance,
    "journeys": journeys.journeys,
    "harmonic_bands": harmonic.harmonic_bands,
    "harmonic_fields": harmonic.harmonic_fields,
    "harmonic_movers": harmonic.harmonic_movers,
    "harmonic_speed": harmonic.harmonic_speed,
    "fleet_alone": alone.fleet_alone,
    "fleet_mapf": grids.fleet_mapf,
    "fleet_narrow": narrow.fleet_narrow,
    "fleet_delays": narrow.fleet_delays,
    "fleet_live": live.fleet_live,
    "fleet_network": network.fleet_network,
    "fleet_page": page.fleet_page,
    "fleet_scale": scale.fleet_scale,
    "edges": hazards.edges,
    "glass_door": hazards.glass_door,
    "paper_scenes": hazards.paper_scenes,
    "among_movers": hazards.among_movers,
    "appears": hazards.appears,
    "behaviours": behaviours.behaviours,
    "paper_rules": behaviours.paper_rules,
    "free_space": behaviours.free_space,
    "laser_line": laser_line.laser_line,
    "skin": skin.skin,
    "blind_doors": blind_doors.blind_doors,
    "blind_hazards": blind_hazards.blind_hazards,
    "blind_places": blind_places.blind_places,
    "blind_people": blind_people.blind_people,
    "blind_clutter": blind_clutter.blind_clutter,
    "blind_unmapped": blind_unmapped.blind_unmapped,
    "blind_errands": blind_errands.blind_errands,
    "reacts": monitor.reacts,
    "ride": hazards.ride,
    "fleet_drive": drive.fleet_drive,
    "fleet_tables": tables.fleet_tables,
    "fleet_gap": gap.fleet_gap,
    "real_maps": real_maps.real_maps,
    "help": start_up.run,
    "monitor_killed": monitor.monitor_killed,
    "steps_out": monitor.steps_out,
    "wrong_chairs": wrong_chairs.wrong_chairs,
    "ros_goals": _with_ros("chair.ros_stack", "ros_goals"),
    "ros_killed": _with_ros("chair.ros_stack", "ros_killed"),
    "journeys_killed": _with_ros("chair.ros_journeys", "journeys_killed"),
    "ros_latency": _with_ros("chair.ros_stack", "ros_latency"),
    "ros_mapping": _with_ros("mapping.ros_mapping", "ros_mapping"),
    "ros_period": _with_ros("chair.ros_stack", "ros_period"),
    "ros_rates": _with_ros("chair.ros_stack", "ros_rates"),
    "inverse": calibration.inverse,
    "straight": closed_loop.straight,
    "closed_loop_margins": closed_loop.closed_loop_margins,
    "gain_watch": closed_loop.gain_watch,
    "host_killed": bridge.host_killed,
    "board_killed": bridge.board_killed,
    "guard_proof": guard.guard_proof,
    "round_trip": bridge.round_trip,
    "fuzz": bridge.run_fuzz,
    "glove": glove.glove,
    "menus": menus.menus,
    "editor": editor.editor,
    "sensor_time": sensor_time.sensor_time,
    "self_mask": sensor_time.self_mask,
    "odometry": odometry.run,
    "odometry_husky": odometry.run_husky,
    "sim_speed": simulation.run_speed,
    "sim_bytes": simulation.run_bytes,
    "sim_odometry": simulation.run_odometry,
    "sim_features": simulation.run_features,
    "sim_bag": simulation.run_bag,
    "sim_thin_stack": simulation.run_thin_stack,
}


def main(names: list[str]) -> int:
    """Run the figures; return exit status 0 if every measured bar is met."""
    wanted = list(FIGURES) if names in ([], ["all"]) else names
    unknown = [name for name in wanted if name not in FIGURES]
    if unknown:
        print(f"there is no figure '{unknown[0]}'; choose among {', '.join(FIGURES)}", file=sys.stderr)
        return 2
    met = True
    for name in wanted:
        out = Path("out") / "acceptance" / f"{name}.json"
        figures = FIGURES[name](out)
        write_json(out, figures)
        met = met and bool(figures["passed"])
        facts = ", ".join(f"{key} {value}" for key, value in figures.items() if not isinstance(value, list | dict))
        print(f"{name}: {facts}", flush=True)
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
