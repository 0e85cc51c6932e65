import json
import os
import pickle
import zipfile

import numpy as np
import pytest
from safetensors.numpy import save

from galton import CheckpointError, UsageError
from galton.saving import checkpoint
from galton.saving.provenance import version

SETTINGS = {"name": "a", "numbers": [1, 2.5, float("inf"), None, True], "nested": {"b": {}, "ü": "σ"}}
ARRAYS = {
    "scalar": np.array(1.5),
    "empty": np.zeros((0, 3), np.float32),
    "flags": np.array([[True], [False]]),
    "count": np.array([-(2**63), 2**63 - 1]),
    "key": np.array([0, 2**32 - 1], np.uint32),
    "numbers/deep/in": np.array([[np.nan, -0.0, np.inf]]),
    "transposed": np.arange(6.0, dtype=np.float32).reshape(2, 3).T,
}


def frame(header, body=b"", length=None):
    header = header if isinstance(header, bytes) else json.dumps(header).encode()
    return (len(header) if length is None else length).to_bytes(8, "little") + header + body


def tensor(shape, offsets, dtype="F32"):
    return {"dtype": dtype, "shape": shape, "data_offsets": offsets}


def with_metadata(text, **tensors):
    return frame({"__metadata__": {"galton": text}} | tensors, b"\0" * 8)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    path = tmp_path_factory.mktemp("small") / "file"
    checkpoint.write(path, {"a": 1}, {"x": np.arange(3, dtype=np.int32), "y": np.array(True)})
    return path.read_bytes()


def refuse(path, content, message=None):
    path.write_bytes(content)
    with pytest.raises(CheckpointError, match=message):
        checkpoint.read(path)


def test_what_is_written_is_read_bit_for_bit_and_the_same_content_gives_the_same_file(tmp_path):
    path = tmp_path / "new" / "folder" / "file"
    checkpoint.write(path, SETTINGS, ARRAYS)
    settings, arrays = checkpoint.read(path)
    assert settings == SETTINGS
    assert arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert (arrays[name].dtype, arrays[name].shape) == (array.dtype, array.shape)
        assert arrays[name].tobytes() == array.tobytes()
    checkpoint.write(tmp_path / "again", SETTINGS, ARRAYS)
    assert (tmp_path / "again").read_bytes() == path.read_bytes()
    checkpoint.write(path, {}, {"../../escape": np.zeros(2), "/absolute": np.zeros(2)})
    assert set(checkpoint.read(path)[1]) == {"../../escape", "/absolute"}
    assert {path.name for path in tmp_path.rglob("*")} == {"again", "new", "folder", "file"}


def test_a_pytree_survives_and_another_structure_is_refused():
    tree = {"a": [np.arange(3), np.float32(1)], "b": (np.zeros((2, 0), bool),)}
    flat = checkpoint.flatten(tree)
    back = checkpoint.unflatten(flat, tree)
    np.testing.assert_array_equal(back["a"][0], tree["a"][0])
    assert back["b"][0].shape == (2, 0)
    for wrong in ({"a": [np.arange(4)]}, {"a": [np.arange(3.0)]}, {"c": np.arange(3)}):
        with pytest.raises(CheckpointError, match="in the checkpoint is"):
            checkpoint.unflatten(flat, wrong)


def test_a_path_that_can_not_be_written_and_a_file_that_is_missing_are_usage_errors(tmp_path):
    (tmp_path / "file").touch()
    for path in (tmp_path / "file" / "below", tmp_path, tmp_path / ("n" * 300)):
        with pytest.raises(UsageError, match="can't be written"):
            checkpoint.write(path, {}, {})
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    (tmp_path / "dangling").symlink_to("nowhere")
    for name in ("nowhere", "dangling"):
        with pytest.raises(UsageError, match=name):
            checkpoint.read(tmp_path / name)


def test_what_read_would_refuse_for_its_size_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr(checkpoint, "MAX_HEADER", 1000)
    with pytest.raises(UsageError, match="too large"):
        checkpoint.write(tmp_path / "file", {"long": "x" * 2000}, {})
    monkeypatch.setattr(checkpoint, "MAX_FILE", 1000)
    with pytest.raises(UsageError, match="too large"):
        checkpoint.write(tmp_path / "file", {}, {"x": np.zeros(1000)})
    assert not list(tmp_path.iterdir())


def test_every_truncation_is_refused(tmp_path, small):
    for length in range(len(small)):
        refuse(tmp_path / "file", small[:length])
    for more in (b"\0", b" ", small):
        refuse(tmp_path / "file", small + more)


def changed(small, change):
    """The file with another header in front of the same numbers."""
    end = 8 + int.from_bytes(small[:8], "little")
    return frame(change(small[8:end]), small[end:])


def test_how_a_header_is_laid_out_is_of_no_matter(tmp_path, small):
    (tmp_path / "small").write_bytes(small)
    for change in (lambda header: header + b" " * 8, lambda header: json.dumps(json.loads(header), indent=1).encode()):
        (tmp_path / "file").write_bytes(changed(small, change))
        (settings, arrays), (_, same) = (checkpoint.read(tmp_path / name) for name in ("file", "small"))
        assert settings == {"a": 1}
        assert {name: array.tobytes() for name, array in arrays.items()} == {n: a.tobytes() for n, a in same.items()}


class Bomb:
    def __init__(self, crater):
        self.crater = crater

    def __reduce__(self):
        return os.system, (f"touch {self.crater}",)


def zipped(path, crater):
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("../data.pkl", pickle.dumps(Bomb(crater)))
    return path.read_bytes()


def npz(path, crater):
    with path.open("wb") as file:
        np.savez(file, allow_pickle=True, x=np.array([Bomb(crater)], object))
    return path.read_bytes()


def test_pickles_and_archives_are_refused_and_do_not_run(tmp_path):
    crater = tmp_path / "it-was-here"
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        bomb = pickle.dumps(Bomb(crater), protocol)
        framed = frame(bomb), with_metadata(bomb.decode("latin-1")), len(bomb).to_bytes(8, "little") + bomb
        for content in (bomb, *framed):
            refuse(tmp_path / "file", content)
    for make in (zipped, npz):
        refuse(tmp_path / "file", make(tmp_path / "archive", crater))
    assert not crater.exists()


DEEP = b"[" * 100_000
RECORD = '{"format": 1, "settings": {}, "sha256": ""}'
HEADERS = [b"", b"null", b"[]", b"{}", b" " * (9 << 20), DEEP, b'{"a":' * 100_000, b"\xff\xfe{}"]
HEADERS += [b'{"__metadata__":{"galton":"{}"},"x":NaN}', b'{"__metadata__":null}', b'{"__metadata__":{"galton":1}}']
TEXTS = [DEEP.decode(), "{}", RECORD.replace("1", "NaN"), RECORD.replace("{", '{"format": 1, ', 1), "1" * 10_000, "[1]"]
SHAPES = [([2], [0, 2**40]), ([2], [8, 0]), ([2], [-8, 0]), ([2**62], [0, 8]), ([2**63, 2**63], [0, 8]), ([-2], [0, 8])]
TENSORS = [
    *({"x": tensor(*of)} for of in (*SHAPES, ([1], [0, 4]), ([2], [0, 8], "PICKLE"), ([4], [0, 8], "BF16"))),
    {"x": tensor([0, 2**62], [0, 0]), "y": tensor([2], [0, 8])},
    {"x": tensor([2], [0, 8]), "y": tensor([2], [0, 8])},
    {"x": tensor([1], [0, 4]), "y": tensor([1], [2, 6])},
    *({"x": odd} for odd in ({}, None)),
    *({name: tensor([2], [0, 8])} for name in ("../../x", "/etc/passwd", "")),
]


def test_hostile_files_give_one_error(tmp_path):
    nonsense = [b"", b"hello, world\n" * 100, b"\0" * 1000, b"\xff" * 1000]
    lengths = [frame(b"{}", length=length) for length in (2**63, 2**64 - 1, 100 << 20)]
    tensors = [with_metadata(RECORD, **tensors) for tensors in TENSORS]
    for content in (*nonsense, *lengths, *map(frame, HEADERS), *map(with_metadata, TEXTS), *tensors):
        refuse(tmp_path / "file", content)


def test_wrong_records_with_a_right_checksum_are_refused(tmp_path):
    arrays = {"x": np.zeros(3)}
    for record, message in (
        ({"format": 0, "settings": {}}, "its format is 0; this version reads 1"),
        ({"format": "1", "settings": {}}, "its format is '1'; this version reads 1"),
        ({"format": 2, "settings": {}}, r"written by a newer version of Galton \(not known, format 2\)"),
        *(({"format": 1, "settings": settings}, "settings") for settings in ([], "text", None)),
        ({"format": 1}, "settings"),
        ({"settings": {}}, "format"),
    ):
        text = json.dumps(record | {"sha256": checkpoint._digest(record, arrays)})
        refuse(tmp_path / "file", save(arrays, {"galton": text}), message)


def test_a_file_of_a_newer_version_is_never_called_damaged(tmp_path):
    """Whatever else it changed: where the checksum stands, for instance."""
    record = {"format": checkpoint.FORMAT + 1, "galton": "99.1", "contents": []}
    content = save({"x": np.zeros(3)}, {"galton": json.dumps(record)})
    refuse(tmp_path / "file", content, r"newer version of Galton \(99\.1, format 2\); this one is .* upgrade")
    with pytest.raises(CheckpointError) as told:
        checkpoint.read(tmp_path / "file")
    assert "damaged" not in str(told.value)


def test_a_file_says_which_version_wrote_it_and_older_ones_did_not(tmp_path):
    checkpoint.write(tmp_path / "new", {"a": 1}, ARRAYS)
    content = (tmp_path / "new").read_bytes()
    header = json.loads(content[8 : 8 + int.from_bytes(content[:8], "little")])
    assert json.loads(header["__metadata__"]["galton"])["galton"] == version()
    record = {"format": 1, "settings": {"a": 1}}
    text = json.dumps(record | {"sha256": checkpoint._digest(record, ARRAYS)})
    arrays = {name: np.asarray(array, order="C") for name, array in ARRAYS.items()}
    (tmp_path / "old").write_bytes(save(arrays, {"galton": text}))
    assert checkpoint.read(tmp_path / "old")[0] == checkpoint.read(tmp_path / "new")[0]
