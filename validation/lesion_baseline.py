#!/usr/bin/env python3
"""Trains a detector of a lesion on half of the people of a data set and tries it on the other half.

    fluorspar dataset validation/lesion_cohort.toml --out people     # a quarter of an hour
    python3 validation/lesion_baseline.py people
    fluorspar design optimize validation/lesion_design.toml          # predicts d' = 1 / loss for the light of the spot alone

It prints the area under the ROC curve of logistic regressions of logarithms of the three channels, of the spot alone and over the rest of
the tongue. Needs numpy, Pillow, scikit-learn and tifffile.
"""

import json
import sys
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedKFold, cross_val_predict

SPLITS = 20


def channels(raw, inside):
    """Logarithms of the means of R, G and B of a mosaic of rows G R and B G over some pixels."""
    of_channels = [[(0, 1)], [(0, 0), (1, 1)], [(1, 0)]]
    values = [np.concatenate([raw[r::2, c::2][inside[r::2, c::2]] for r, c in sites]) for sites in of_channels]
    return [np.log(max(1.0, one.mean())) for one in values]


def main():
    folder = Path(sys.argv[1])
    spots = {mask.name[:-12]: np.asarray(Image.open(mask)) == 1 for mask in sorted(folder.glob("masks/*_lesions.png"))}
    has = np.array([spot.any() for spot in spots.values()])
    # The spot lies at the same place of all tongues: where nine of ten who have it show it, and nobody
    shown = np.mean([spot for spot in spots.values() if spot.any()], axis=0)
    core, free = shown > 0.9, shown == 0
    rows = []
    for name in spots:
        frame = folder / "images" / f"{name}_blue.tiff"
        facts = json.loads(Path(f"{frame}.json").read_text())
        raw = tifffile.imread(frame) - facts["black_level"]
        parts = np.asarray(Image.open(folder / "masks" / f"{name}_parts.png"))
        tongue = parts == np.bincount(parts[core]).argmax()
        rows.append(channels(raw, core) + channels(raw, tongue & free))
    rows = np.array(rows)
    print(f"{has.size} people, {has.sum()} with the lesion")
    for title, features in [("spot alone", rows[:, :3]), ("spot over tongue", rows[:, :3] - rows[:, 3:])]:
        features = (features - features.mean(0)) / features.std(0)
        area = []
        for split in range(SPLITS):
            halves = StratifiedKFold(2, shuffle=True, random_state=split)
            model = LogisticRegression(C=10.0)
            found = cross_val_predict(model, features, has, cv=halves, method="predict_proba")[:, 1]
            area.append(roc_auc_score(has, found))
        print(f"{title}: area under the ROC curve {np.mean(area):.3f}")


main()
