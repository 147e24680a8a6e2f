# A gesture: the poses of a second stone, or of the hand that wanders.
# Takes: the face, and a second stone where there is one. Gives: the exposure that all poses of a gesture leave.
# Poses are jobs of their own, many in each.

import numpy as np

PRESSED = {
    "contact_modulus_MPa": CONTACT_MODULUS_MPA,
    "tolerance": config["macroscale"]["tolerance"],
    "patch_mm": PATCH_MM,
    "size_mm": SQUARE_MM,
    "through": LOAD["through"],
}
POSE_BATCHES = {
    f"{RESULTS}/gesture/poses_{number}.h5": batch
    for number, batch in enumerate(batches_of(POSES), start=1)
}
# Poses that a figure shows, in even steps.
SHOWN_POSES = 4

for batch, poses in POSE_BATCHES.items():

    rule:
        name:
            f"press_{Path(batch).stem}"
        input:
            face=PRESSED_FACE,
            second=SECOND,
        output:
            batch=batch,
        log:
            f"{RESULTS}/logs/press_{Path(batch).stem}.log",
        params:
            **PRESSED,
            poses=poses.to_dict(),
            patches=PLACES,
            shown=[
                round(place)
                for place in np.linspace(0, len(POSES) - 1, min(len(POSES), SHOWN_POSES))
            ],
            code=code("press_poses.py"),
        message:
            f"Pressing the stone in {len(poses)} poses"
        script:
            "../scripts/press_poses.py"


if POSE_BATCHES:

    rule gather_exposure:
        input:
            batches=list(POSE_BATCHES),
            pressures=f"{RESULTS}/coupling/pressures.csv" if SCANNED else [],
        output:
            **({"table": table("exposure", "3 Coupling")} if SCANNED else {}),
            fields=f"{RESULTS}/gesture/exposure.h5",
        log:
            f"{RESULTS}/logs/gather_exposure.log",
        params:
            code=code("gather_exposure.py"),
        message:
            "Putting the poses together"
        script:
            "../scripts/gather_exposure.py"
