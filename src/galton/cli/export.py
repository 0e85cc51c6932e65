"""galton export: a trained policy for where there is no Galton, and the card that goes with it."""

import dataclasses
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from galton.cli._reading import Imports, import_typed, read_options
from galton.cli._runs import model_of, points
from galton.deploy import card, export
from galton.errors import require, require_word
from galton.models import Model
from galton.saving import files
from galton.saving.result_folder import CARD, CONFIG, CONTRACT, METRICS, POLICY, read_settings

FORMATS = ("onnx", "card")


@dataclasses.dataclass(frozen=True)
class Options:
    """Write a trained policy as an ONNX file with its contract, or its model card, or both."""

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """A run folder of `galton train`, whose model.safetensors is taken, or the file of a model."""
    format: Annotated[tuple[str, ...], tyro.conf.arg(metavar="{onnx,card} ...")] = ("onnx",)
    """onnx: policy.onnx and policy.json, which says what it takes and gives. card: model_card.md."""
    imports: Imports = ()
    out: Path | None = None
    """The folder to write into; by default the one of the model."""


def main(arguments: Sequence[str]) -> None:
    """Write the files that are asked for."""
    options = read_options(Options, "export", arguments)
    import_typed(options.imports)
    for name in options.format:
        require_word("format", name, FORMATS)
    require(len(options.format) > 0, f"format is empty; choose from {', '.join(FORMATS)}")
    formats, file = options.format, model_of(options.run)
    model, settings = Model.load(file), _settings(file, "card" in formats)
    out = options.out or file.parent
    require(not out.exists() or out.is_dir(), f"out is {out}, which is a file; name a folder")
    written = [*((POLICY, CONTRACT) if "onnx" in formats else ()), *((CARD,) if "card" in formats else ())]
    files.check_no_way_out("out", out, *written)
    if "onnx" in formats:
        path = export(model, out / POLICY, _origin(file, settings))
        print(f"policy: {path}\ncontract: {path.with_suffix('.json')}")
    if "card" in formats:
        text = card.card(model, settings, points(file.with_name(METRICS)), file.name)
        with files.named("out", out):
            files.write(out / CARD, text.encode())
        print(f"card: {out / CARD}")


def _settings(file: Path, needed: bool) -> dict[str, object]:
    """The settings of the run that the model lies in; UsageError where they are needed and not there."""
    settings = read_settings(file.parent)
    where = f"run is {file}, beside which there is no {CONFIG}"
    require(bool(settings) or not needed, f"{where}; a card is written of a run folder of `galton train`")
    return settings


def _origin(file: Path, settings: dict[str, object]) -> dict[str, object]:
    """The origin of the policy, as far as its model does not say it."""
    model = {"model": file.name, "model_sha256": hashlib.sha256(files.read(file, files.DATA)).hexdigest()}
    return {name: value for name, value in settings.items() if name in ("env", "env_kwargs", "command")} | model
