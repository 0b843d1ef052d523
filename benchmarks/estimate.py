"""Mean error of the estimated bodies beside the figure published for their estimator.

    python -m benchmarks.estimate [--bodies 48] [--draws 1]

Every pose is estimated `draws` times on each of `bodies` bodies, which are drawn as the humans'
are; that takes minutes. What `ESTIMATORS` holds as turn_deg is calibrated so that the mean is the
published figure.
"""

from __future__ import annotations

import argparse

import numpy as np

import seeds
from subjects.open import OpenHumans
from subjects.open.bodies import body
from subjects.open.bodies.estimate import ESTIMATORS, EstimatorName, estimated
from subjects.open.bodies.face import draw_face
from subjects.open.bodies.poses import POSES

SEED = 0
FARTHEST = 0.03
"""Share of the published figure that the mean may be off."""


def drawn(count: int) -> list[body.Rest]:
    """Bodies of all ages, with faces, as `OpenHumans` draws them."""
    ages = OpenHumans.min_age, OpenHumans.max_age
    result = []
    for subject in OpenHumans(count=count).ids():
        _, phenotype = body.draw_phenotype(seeds.generator(SEED, subject, "phenotype"), *ages)
        face = draw_face(seeds.generator(SEED, subject, "face"))
        result.append(body.rest_body(phenotype, face))
    return result


def errors_mm(name: EstimatorName, rests: list[body.Rest], draws: int) -> np.ndarray:
    """(bodies, poses * draws) PA-MPJPE in millimetres."""
    result = np.empty((len(rests), len(POSES) * draws))
    for k, rest in enumerate(rests):
        generator = seeds.generator(SEED, f"body {k}", "estimate")
        for j, pose in enumerate([*POSES.values()] * draws):
            _, record = estimated(pose, rest, name, generator)
            result[k, j] = record["pa_mpjpe_mm"]
    return result


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bodies", type=int, default=48)
    parser.add_argument("--draws", type=int, default=1)
    chosen = parser.parse_args()
    rests = drawn(chosen.bodies)
    print("estimator        turn_deg  draws  PA-MPJPE, mm     published")
    off = []
    for name in sorted(ESTIMATORS):
        estimator = ESTIMATORS[name]
        errors = errors_mm(name, rests, chosen.draws)
        # A tall body errs by more millimetres in every pose: bodies are what varies.
        mean, spread = errors.mean(), errors.mean(axis=1).std(ddof=1) / np.sqrt(len(errors))
        print(
            f"{estimator.title:16s} {estimator.turn_deg:8.2f}  {errors.size:5d}  "
            f"{mean:5.1f} ± {spread:3.1f}      {estimator.error_mm:5.1f}"
        )
        if abs(mean / estimator.error_mm - 1.0) > FARTHEST:
            off.append(estimator.title)
    if off:
        raise SystemExit(f"not as published: {', '.join(off)}; calibrate turn_deg anew")


if __name__ == "__main__":
    main()
