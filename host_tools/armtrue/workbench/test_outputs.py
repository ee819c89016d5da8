"""The archive of Export stands for itself: its commands and its notebook find the measurements beside them."""

from __future__ import annotations

import io
import json
import shlex
import zipfile
from pathlib import Path

import pytest
import yaml

from armtrue.fitting import Fit
from armtrue.io import load_data
from armtrue.workbench.outputs import make


@pytest.mark.parametrize("through_dataset_yaml", [False, True])
def test_archive_holds_the_measurements_that_its_commands_and_notebook_read(
    engine, tmp_path, monkeypatch, through_dataset_yaml
):
    if through_dataset_yaml:
        engine.session.data = as_foreign(tmp_path, engine)
    count, folder = engine.session.data.count, tmp_path / "unpacked"
    zipfile.ZipFile(io.BytesIO(make(engine.session, "export").content)).extractall(folder)
    for file in tmp_path.glob("data*"):
        file.unlink()
    monkeypatch.chdir(folder)
    fit = next(
        line for line in Path("commands.sh").read_text().splitlines() if line.startswith("armtrue fit")
    )
    assert Path(shlex.split(fit)[2]).is_file()
    names: dict = {}
    exec("".join(json.loads(Path("session.ipynb").read_text())["cells"][0]["source"]), names)
    assert names["data"].count == count
    assert Fit.load("fit.json").data.count == count


@pytest.mark.parametrize("name", ["commands", "notebook"])
def test_commands_and_notebook_alone_name_the_measurements_in_full(engine, tmp_path, name):
    assert str(tmp_path / "data.csv") in make(engine.session, name).content.decode()


def as_foreign(folder: Path, engine):
    """The session's measurements, read through a dataset.yaml that lies in another folder."""
    names = Path("data.csv").read_text().split("\n", 1)[0].split(",")
    place = folder / "guessed" / "dataset.yaml"
    place.parent.mkdir()
    place.write_text(yaml.safe_dump({"file": "../data.csv", "columns": {name: name for name in names}}))
    return load_data(place, engine.robot)
