"""Two measured stones: the pebble against the rock of ../shared/data, in 100 poses of a stroke.

Prints what a pose costs, its memory, and what comes out; draws it to build/two_tools.png. The
rock's mesh is an open sheet of another stone: nothing here is a result about the use of the pebble.
"""

import resource
import time
from pathlib import Path

import yaml

from gst.figures.macroscale import exposure_figure
from gst.figures.style import save_figure
from gst.patches import read_patches
from gstlib.contact import Interface, Load, contact_at_pressure
from gstlib.coupling.pressures import couple_scales
from gstlib.io.meshes import read_mesh
from gstlib.macroscale.active_tool import ActiveTool
from gstlib.macroscale.face import grid_macroscale
from gstlib.macroscale.gesture import (
    Gesture,
    exposure,
    exposure_table,
    press_poses,
    stroke_poses,
)
from gstlib.surfaces.footprints import square_of

ROOT = Path(__file__).parents[1]
ROCK = "../shared/data/grasselli-mit/example_surface.stl"
PRESSED = {"contact_modulus_MPa": 10346.0, "tolerance": 1e-9}
FORCE_N, FACE_MM, PATCH_MM = 550.0, 15.0, 0.85


def main() -> None:
    config = yaml.safe_load((ROOT / "config/pebble.yaml").read_text())
    size = config["square"]["size_mm"]
    patches = read_patches(ROOT / config["patches"], size_mm=size, patch_size_mm=PATCH_MM)
    pebble, rock = (
        read_mesh(ROOT / file, unit="mm") for file in (config["inputs"]["mesh"], ROCK)
    )
    x, y, _ = rock.bounds.mean(axis=0) - size / 2
    corners = [[x, y, 0.0], [x + size, y, 0.0], [x, y + size, 0.0]]
    face, counterface = grid_macroscale(
        pebble,
        **config["square"],
        grid=100,
        face_mm=FACE_MM,
        interpolation="linear",
        source="pebble",
        active_tool=ActiveTool(rock, {"points_mm": corners}, 3.0, ROCK),
    )
    poses = stroke_poses(stroke_mm=6.0, poses=100, force_N=FORCE_N)
    through = size / 2, size / 2
    gesture = Gesture(counterface, is_mesh=True, size_mm=size, through=through, poses=poses)
    shown = [0, 33, 66, 99]
    begun = time.process_time()
    batch = press_poses(
        face.height, gesture, patches, patch_mm=PATCH_MM, shown=shown, **PRESSED
    )
    cost = (time.process_time() - begun) / len(poses)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{1e3 * cost:.1f} ms of CPU a pose at 300²; peak {peak:.0f} MB, both meshes read")
    single = contact_at_pressure(
        Interface(face.height, face.counterface),
        Load.of_force(FORCE_N, face.height, through),
        modulus=PRESSED["contact_modulus_MPa"],
        tolerance=PRESSED["tolerance"],
        source="pebble",
    )
    pressures = couple_scales(single.pressure, single.pressure, patches, patch_mm=PATCH_MM)
    found = exposure([batch])
    print(exposure_table(found, pressures).round(3).to_string(index=False))
    on_square = (square_of(of, size) for of in (found, single.to_dataset()))
    figure = exposure_figure(*on_square, patches, patch_size_mm=PATCH_MM)
    picture = Path("build/two_tools.png")
    picture.parent.mkdir(exist_ok=True)
    save_figure(figure, picture)
    print(picture)


if __name__ == "__main__":
    main()
