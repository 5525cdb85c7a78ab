import hashlib
import json
import shutil
from pathlib import Path

import pytest
from paths import GOLDEN
from study_tables import simulated_study, write_study


@pytest.fixture
def study(tmp_path) -> Path:
    """A small simulated study whose first two participants have recordings of the phantom; one run is slow."""
    tables, folder = simulated_study(participants=8, trials=2), tmp_path / "study"
    trials = tables["trials"]
    trials["recording"], trials["recording_sha256"] = "", ""
    trials["procedure_sha256"], trials["software"] = "", "0.1.0"
    (folder / "recordings").mkdir(parents=True)
    for condition, name in (("visual", "wrong_place_then_hit"), ("visual_haptic", "align_then_approach")):
        shutil.copy(GOLDEN / f"{name}.mcap", folder / "recordings")
        rows = (
            (trials["condition"] == condition)
            & trials["participant"].isin(["S01", "S02"])
            & (trials["trial"] == 1)
        )
        trials.loc[rows, "recording"] = f"recordings/{name}.mcap"
        digest = hashlib.sha256((GOLDEN / f"{name}.mcap").read_bytes()).hexdigest()
        trials.loc[rows, "recording_sha256"] = digest
    trials["images_per_s"] = 30.0
    trials.loc[trials.index[trials["phase"] == "trial"][0], "images_per_s"] = 9.0
    write_study(folder, tables)
    protocol = {"study.toml": "[quality]\nmin_images_per_s = 20\n"}
    (folder / "study.json").write_text(json.dumps({"parts": protocol}))
    return folder
